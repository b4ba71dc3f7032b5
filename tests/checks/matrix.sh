#!/bin/bash
# hydra.h and hydra_vk.h under many compilers, standards and settings, with every warning an error, and in the company
# that users put them in: macros of windows.h, other headers before and after, twice in a file, in two files.
. "$(dirname "$0")/common.sh"
header=${HYDRA_HEADER:-$PWD/hydra.h} vk_header=${HYDRA_VK_HEADER:-$PWD/hydra_vk.h}
for file in "$header" "$vk_header"; do [ -f "$file" ] || { wrong "$file is missing"; finish; }; done
list=$scratch/list
: > "$list"
add() { printf '%s|%s\n' "$1" "$2" >> "$list"; }

compile() { # name, compiler, standard, flags, file without suffix: one compilation to nowhere
    local language=c with=$warnings_c driver=$2
    case $3 in c++* | gnu++*)
        language=c++ with=$warnings
        driver=${driver/gcc/g++} driver=${driver/clang/clang++} ;;
    esac
    add "$1" "$driver -std=$3 $with $4 -x $language -c $5 -o /dev/null"
}

# ---- sources

printf '#define HYDRA_IMPLEMENTATION\n#include "%s"\n' "$header" > "$scratch/whole.c"
printf '#include "%s"\n' "$header" > "$scratch/plain.c"
cat > "$scratch/again.c" <<C
#include "$header"
#define HYDRA_IMPLEMENTATION
#include "$header"
#include "$header"
#undef HYDRA_IMPLEMENTATION
#include "$header"
C
cat > "$scratch/before.c" <<C
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <math.h>
#include <errno.h>
#include <signal.h>
#define HYDRA_IMPLEMENTATION
#include "$header"
C
cat > "$scratch/after.c" <<C
#define HYDRA_IMPLEMENTATION
#include "$header"
#include <stdio.h>
#include <time.h>
#include <errno.h>
#include <signal.h>
#include <setjmp.h>
#include <ctype.h>
C
# Both headers: as hydra_vk.h says it, twice, and after what Vulkan's users include.
printf '#define HYDRA_IMPLEMENTATION\n#include "%s"\n#define HYDRA_VK_IMPLEMENTATION\n#include "%s"\n' "$header" "$vk_header" > "$scratch/both.c"
printf '#include "%s"\n' "$vk_header" > "$scratch/vk_plain.c"
{ cat "$scratch/vk_plain.c" "$scratch/both.c" "$scratch/vk_plain.c" && printf '#include <vulkan/vulkan.h>\n'; } > "$scratch/vk_again.c"
{ printf '#define VK_NO_PROTOTYPES\n#include <vulkan/vulkan.h>\n' && cat "$scratch/both.c"; } > "$scratch/vk_volk.c"
{ printf '#include <vulkan/vulkan.h>\n' && cat "$scratch/both.c"; } > "$scratch/vk_linked.c"
# What windows.h, X11 and old code define, but after the system's headers, which would not survive it either.
{
    printf '#include <%s>\n' stddef.h stdint.h stdbool.h float.h limits.h math.h stdarg.h stdio.h stdlib.h string.h time.h \
        sys/time.h unistd.h pthread.h
    printf '#ifdef __x86_64__\n#include <immintrin.h>\n#endif\n'
    for word in near far small hyper interface IN OUT OPTIONAL CONST VOID STRICT pascal cdecl; do printf '#define %s\n' $word; done
    printf '#define %s ((void)0)\n' I J min max
    printf '#define min(a, b) (((a) < (b)) ? (a) : (b))\n#define max(a, b) (((a) > (b)) ? (a) : (b))\n' | sed 's/^#define \(min\|max\)(/#undef \1\n&/'
    printf '#define %s 0\n' ERROR NULL_HANDLE TRUE FALSE True False None Always Success Status DIFFERENCE RELATIVE ABSOLUTE OK DEBUG NDEBUG
    printf '#define %s 1\n' PI EPS EPSILON INFINITE CLAMP ALIGN LIKELY UNLIKELY ARRAY_SIZE COUNT MAX MIN ABS SWAP
    printf '#define HYDRA_IMPLEMENTATION\n#include "%s"\n' "$header"
} > "$scratch/hostile.c"
# The same macros after Vulkan's headers, which would not survive them either.
{ printf '#include <vulkan/vulkan.h>\n#include <dlfcn.h>\n' && sed '/HYDRA_IMPLEMENTATION/,$d' "$scratch/hostile.c" && cat "$scratch/both.c"; } > "$scratch/vk_hostile.c"
cat > "$scratch/user.c" <<C
#include "$header"
int main(void) {
    hydra_context *context = hydra_create(NULL);
    return context && hydra_destroy(context) == HYDRA_OK ? 0 : 1;
}
C
cat > "$scratch/vk_user.c" <<C
#include "$header"
#include "$vk_header"
int main(void) {
    uint32_t count = 0;
    hydra_context *context = NULL;
    hydra_result found = hydra_vk_list_devices(NULL, NULL, &count), made = hydra_vk_create(NULL, NULL, &context);
    if (made == HYDRA_OK && hydra_destroy(context) != HYDRA_OK) return 1;
    return made == HYDRA_OK ? found != HYDRA_OK || count == 0 : made != HYDRA_ERROR_DEVICE;
}
C
cat > "$scratch/rays.c" <<C
#define HYDRA_STATIC
#define HYDRA_IMPLEMENTATION
#include "$header"
int main(void) {
    const float corners[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
    const uint32_t triangle[3] = {0, 1, 2};
    hydra_ray ray = {{0.25f, 0.25f, 1}, 0, {0, 0, -1}, 2};
    hydra_hit hit;
    uint8_t occluded;
    hydra_mesh_desc mesh;
    hydra_context *context = hydra_create(NULL);
    hydra_scene *scene = hydra_scene_create(context);
    memset(&mesh, 0, sizeof mesh);
    mesh.positions.data = corners;
    mesh.positions.count = 3;
    mesh.indices.data = triangle;
    mesh.indices.count = 3;
    hydra_scene_add_mesh(scene, &mesh);
    if (hydra_scene_commit(scene) != HYDRA_OK) return 1;
    hydra_scene_closest_hits(scene, &ray, &hit, 1);
    hydra_scene_any_hits(scene, &ray, &occluded, 1);
    hydra_destroy(context);
    return hit.t == 1 && occluded ? 0 : 1;
}
C
sed 's/#include/#define HYDRA_STATIC\n#define HYDRA_IMPLEMENTATION\n&/' "$scratch/user.c" > "$scratch/static.c"

# ---- every standard, compiler and setting, without code generation

for compiler in gcc clang; do
    for standard in c99 c11 c++11 c++17; do
        for setting in "" -DHYDRA_STATIC -DHYDRA_NO_THREADS -DHYDRA_NO_SIMD; do
            compile "$compiler-$standard${setting:+-${setting#-DHYDRA_}}" $compiler $standard "-fsyntax-only $setting" "$scratch/whole.c"
        done
        compile "$compiler-$standard-plain" $compiler $standard -fsyntax-only "$scratch/plain.c"
    done
    for file in again before after hostile; do
        compile "$compiler-c99-$file" $compiler c99 -fsyntax-only "$scratch/$file.c"
        compile "$compiler-c++11-$file" $compiler c++11 -fsyntax-only "$scratch/$file.c"
    done
    compile "$compiler-gnu99" $compiler gnu99 -fsyntax-only "$scratch/whole.c"
    compile "$compiler-gnu++20" $compiler gnu++20 -fsyntax-only "$scratch/whole.c"
done

for compiler in gcc clang; do
    for standard in c99 c++11; do
        for setting in "" -DHYDRA_STATIC -DVK_NO_PROTOTYPES; do
            compile "$compiler-$standard-vk${setting:+-${setting#-D}}" $compiler $standard "-fsyntax-only $setting" "$scratch/both.c"
        done
        for file in vk_plain vk_volk vk_linked vk_again vk_hostile; do
            compile "$compiler-$standard-$file" $compiler $standard -fsyntax-only "$scratch/$file.c"
        done
    done
done
compile gcc-c++17-vk-NO_THREADS-NO_SIMD gcc c++17 "-fsyntax-only -DHYDRA_NO_THREADS -DHYDRA_NO_SIMD" "$scratch/both.c"
compile clang-gnu++20-vk clang gnu++20 -fsyntax-only "$scratch/both.c"

# ---- with code generation, where optimisers see more (and warn more): half of them with both headers

compile gcc-c99-O2 gcc c99 -O2 "$scratch/whole.c"
compile gcc-c++17-O2-vk gcc c++17 -O2 "$scratch/both.c"
compile clang-c99-O2-vk clang c99 -O2 "$scratch/both.c"
compile clang-c++11-O2 clang c++11 -O2 "$scratch/whole.c"
compile gcc-c11-O3-fast-vk gcc c11 "-O3 -march=native -ffast-math" "$scratch/both.c"
compile clang-c++17-O3-fast clang c++17 "-O3 -march=native -ffast-math" "$scratch/whole.c"
compile gcc-c99-O2-NO_SIMD-NO_THREADS gcc c99 "-O2 -DHYDRA_NO_SIMD -DHYDRA_NO_THREADS" "$scratch/whole.c"
compile clang-c99-O2-STATIC clang c99 "-O2 -DHYDRA_STATIC" "$scratch/whole.c"

# ---- linked: the implementation in one file and its use in another, C with C++ both ways; alone when static

link() { # name, compiler of the implementation, of the user, linker
    local object=$scratch/$1
    add "link-$1" "$2 -O0 -c $scratch/whole.c -o $object.1.o && $3 -O1 -c $scratch/user.c -o $object.2.o && $4 $object.1.o $object.2.o -o $object -lm -pthread && $object"
}
link c-c "gcc -std=c99 $warnings_c" "clang -std=c99" gcc
link c-c++ "clang -std=c99 -x c" "g++ -std=c++11 -x c++" g++
link c++-c "g++ -std=c++11 -x c++" "gcc -std=c99 -x c" g++
add link-static "gcc -std=c99 $warnings_c -O0 $scratch/static.c -o $scratch/static -lm -pthread && $scratch/static"
add link-no-threads "gcc -std=c99 $warnings_c -O0 -DHYDRA_NO_THREADS $scratch/static.c -o $scratch/unthreaded -lm && $scratch/unthreaded && ! nm -u $scratch/unthreaded | grep pthread"
# A program that only casts rays gets little more than half of the code, as the header says.
add link-rays "gcc -std=c99 -O1 $scratch/rays.c -o $scratch/rays -lm -pthread && $scratch/rays && gcc -std=c99 -O1 -c $scratch/whole.c -o $scratch/rays.o && test \$(size $scratch/rays | awk 'NR == 2 { print 9 * \$1 }') -lt \$(size $scratch/rays.o | awk 'NR == 2 { print 5 * \$1 }')"
# Without Vulkan's library; where there is none at run time, or no device, the program says so and ends well.
add link-vk "clang -std=c99 $warnings_c -O0 -c $scratch/both.c -o $scratch/vk.1.o && g++ -std=c++11 -x c++ -c $scratch/vk_user.c -o $scratch/vk.2.o && g++ $scratch/vk.1.o $scratch/vk.2.o -o $scratch/vk -lm -pthread -ldl && $scratch/vk"

# ---- other machines, where this one can compile for them

other() { # name, compiler: as C99
    if printf '#include <stdio.h>\n#include <math.h>\n' | $2 -x c -fsyntax-only - 2> /dev/null; then
        add "$1" "$2 -std=c99 $warnings_c -O1 -c $scratch/whole.c -o /dev/null"
    else
        note "not checked for want of a toolchain: $1 ($2)"
    fi
}
other 32-bit "gcc -m32"
other aarch64 aarch64-linux-gnu-gcc
other windows x86_64-w64-mingw32-gcc

run_all < "$list"
finish "$jobs_run compilations"
