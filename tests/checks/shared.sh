#!/bin/bash
# Every file of shaders/shared alone, and every part of src alone: shared ones as C99, as C++11, as C99 with
# double for hyk_real, and as GLSL 4.60 through glslangValidator and spirv-val; host ones as C99 and C++11, those of
# src/vk after hydra.h. Every kernel of shaders/ as GLSL.
. "$(dirname "$0")/common.sh"
alone="-fsyntax-only"
oracle=${warnings_c/-Wdouble-promotion/}

shader() { # file: a compute shader that includes it
    printf '%s\n' '#version 460' '#extension GL_GOOGLE_include_directive : require' '#define HYK_GLSL 1' "#include \"$1\"" \
        'layout(local_size_x = 1) in;' 'void main() {}'
}

find shaders/shared -name '*.h' | sort > "$scratch/files"
[ -s "$scratch/files" ] || wrong "shaders/shared is empty"
while read -r file; do
    name=$(basename "$file" .h)
    printf '#include "%s"\n' "$PWD/$file" > "$scratch/$name.c"
    cp "$scratch/$name.c" "$scratch/$name.cpp"
    shader "$(basename "$file")" > "$scratch/$name.comp"
    glslang="glslangValidator -V --target-env vulkan1.2 -I$(dirname "$file") $scratch/$name.comp -o $scratch/$name.spv"
    cat <<JOBS
$name.c99|gcc -std=c99 $warnings_c $alone $scratch/$name.c
$name.c++11|g++ -std=c++11 $warnings $alone $scratch/$name.cpp
$name.clang|clang -std=c99 $warnings_c $alone $scratch/$name.c
$name.double|gcc -std=c99 $oracle -DHYK_REAL=double $alone $scratch/$name.c
$name.glsl|$glslang && ! $glslang | grep -E 'WARNING|ERROR' && spirv-val --target-env vulkan1.2 $scratch/$name.spv
JOBS
done < "$scratch/files" > "$scratch/list"
find src -name '*.h' ! -name '*.inc.h' ! -path 'src/vk/*' | sort | while read -r file; do
    name=$(printf '%s' "${file%.h}" | tr / _)
    printf '#define HYDRA_IMPLEMENTATION\n#include "%s"\n' "$PWD/$file" > "$scratch/$name.c"
    cp "$scratch/$name.c" "$scratch/$name.cpp"
    cat <<JOBS
$name.c99|gcc -std=c99 $warnings_c $alone $scratch/$name.c
$name.c++11|g++ -std=c++11 $warnings $alone $scratch/$name.cpp
JOBS
done >> "$scratch/list"
for file in src/vk/*.h; do
    name=vk_$(basename "$file" .h)
    printf '#define HYDRA_IMPLEMENTATION\n#define HYDRA_VK_IMPLEMENTATION\n#include "%s"\n' "$PWD/$file" > "$scratch/$name.c"
    printf '%s\n' "$name.c99|gcc -std=c99 $warnings_c $alone -I$PWD $scratch/$name.c"
done >> "$scratch/list"
for file in shaders/*.comp; do
    name=$(basename "$file" .comp)
    kernel="glslangValidator -V --target-env vulkan1.2 -Ishaders/shared -Ishaders $file -o $scratch/$name.kernel.spv"
    printf '%s\n' "$name.kernel|$kernel && ! $kernel | grep -E 'WARNING|ERROR' && spirv-val --target-env vulkan1.2 $scratch/$name.kernel.spv"
done >> "$scratch/list"
run_all < "$scratch/list"
finish "$jobs_run compilations"
