/* transform.h: 3x4 row-major transforms in double, and small vectors */
#ifndef TRANSFORM_H
#define TRANSFORM_H

#include <assimp/scene.h>

#include <math.h>

typedef struct transform {
    double m[12];
} transform;

static inline transform transform_from_assimp(const struct aiMatrix4x4 *a) {
    transform t = {{a->a1, a->a2, a->a3, a->a4, a->b1, a->b2, a->b3, a->b4, a->c1, a->c2, a->c3, a->c4}};
    return t;
}

static inline transform transform_from_floats(const float m[12]) {
    transform t;
    for (int i = 0; i < 12; i++) t.m[i] = (double)m[i];
    return t;
}

/* First b, then a. */
static inline transform transform_multiply(const transform *a, const transform *b) {
    transform t;
    for (int row = 0; row < 3; row++)
        for (int column = 0; column < 4; column++) {
            double sum = column == 3 ? a->m[4 * row + 3] : 0.0;
            for (int k = 0; k < 3; k++) sum += a->m[4 * row + k] * b->m[4 * k + column];
            t.m[4 * row + column] = sum;
        }
    return t;
}

static inline void transform_vector(const transform *t, const double v[3], double out[3]) {
    for (int i = 0; i < 3; i++) out[i] = t->m[4 * i] * v[0] + t->m[4 * i + 1] * v[1] + t->m[4 * i + 2] * v[2];
}

static inline void transform_point(const transform *t, const double p[3], double out[3]) {
    transform_vector(t, p, out);
    for (int i = 0; i < 3; i++) out[i] += t->m[4 * i + 3];
}

/* The cofactors of the linear part: determinant times inverse transpose. They carry normals. */
static inline void transform_cofactors(const transform *t, double c[9]) {
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            int i1 = (i + 1) % 3, i2 = (i + 2) % 3, j1 = (j + 1) % 3, j2 = (j + 2) % 3;
            c[3 * i + j] = t->m[4 * i1 + j1] * t->m[4 * i2 + j2] - t->m[4 * i1 + j2] * t->m[4 * i2 + j1];
        }
}

static inline double transform_determinant(const transform *t) {
    double c[9];
    transform_cofactors(t, c);
    return t->m[0] * c[0] + t->m[1] * c[1] + t->m[2] * c[2];
}

/* False when the vector has no direction. */
static inline int vector_normalize(double v[3]) {
    double length = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    if (!(length > 0.0) || !(length < INFINITY)) return 0;
    for (int i = 0; i < 3; i++) v[i] /= length;
    return 1;
}

static inline void vector_cross(const double a[3], const double b[3], double out[3]) {
    for (int i = 0; i < 3; i++) out[i] = a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3];
}

#endif
