#!/bin/bash
# Compiles shaders/*.comp and writes them as C arrays of SPIR-V words.
#
#     compile.sh OUTPUT      writes src/vk/spirv.h; needs glslang-tools and spirv-tools
#     compile.sh --sources   prints for each kernel its name and the hash of its sources; needs neither
#     compile.sh --tools     prints the versions of both, as they stand in OUTPUT; fails where one is missing
#
# OUTPUT depends on the sources and on the two tools alone: no date, no path of this machine.
set -u -o pipefail
export LC_ALL=C
case ${1-} in
    '' | -h | --help) sed -n '2,/^set/s/^# \{0,1\}//p' "$0" && exit 2 ;;
    /* | -*) output=$1 ;;
    *) output=$PWD/$1 ;;
esac
cd "$(dirname "$0")" || exit 1

die() {
    printf 'compile.sh: %s\n' "$*" >&2
    exit 1
}

sha256() { if command -v sha256sum > /dev/null; then sha256sum; else shasum -a 256; fi | cut -d' ' -f1; }

sources() { # file: it and what it includes, at any depth, each once; C's own headers stand in < >
    local list=("$1") i=0 file name
    while [ $i -lt ${#list[@]} ]; do
        while read -r name; do
            for file in "$(dirname "${list[i]}")/$name" "shared/$name" "$name"; do [ -f "$file" ] && break; done
            [ -f "$file" ] || die "${list[i]} includes $name, which is not there"
            file=${file#./}
            [[ " ${list[*]} " == *" $file "* ]] || list+=("$file")
        done < <(sed -nE 's/^[ \t]*#[ \t]*include[ \t]*"([^"]*)".*/\1/p' "${list[i]}")
        i=$((i + 1))
    done
    printf '%s\n' "${list[@]}" | sort
}

hash_of() { # kernel: the hash of its sources in the order of their names
    local files
    files=$(sources "$1.comp") || return 1
    # shellcheck disable=SC2086
    cat $files | sha256
}

tools() {
    local glslang tools
    command -v glslangValidator > /dev/null && command -v spirv-opt > /dev/null && command -v spirv-val > /dev/null || return 1
    glslang=$(glslangValidator --version | sed -n '1s/^.*[: ]//p')
    tools=$(spirv-opt --version 2>&1 | sed -n '1s/^SPIRV-Tools \([^ ]*\).*/\1/p')
    printf 'glslang %s, spirv-tools %s\n' "${glslang:-of no known version}" "${tools:-of no known version}"
}

compile() { # kernel, folder
    local words=$2/$1.spv messages
    messages=$(glslangValidator -V --quiet --target-env vulkan1.2 -Ishared -I. "$1.comp" -o "$words.plain" 2>&1) && [ -z "$messages" ] || {
        printf '%s.comp:\n%s\n' "$1" "$messages" >&2
        return 1
    }
    local how=-O
    # Mesa 22.3 makes registers of phis in loops twice over: it had better find variables, for whose sake -O is left out.
    [ "$1" != trace_texels ] || how=
    spirv-opt $how --strip-debug --compact-ids --target-env=vulkan1.2 "$words.plain" -o "$words" && spirv-val --target-env vulkan1.2 "$words"
}

kernel() { # name, folder: its lines of the output. Decimal: it is shorter than hexadecimal, by a fifth.
    local hash bytes
    hash=$(hash_of "$1") && bytes=$(wc -c < "$2/$1.spv") || return 1
    printf '\n/* shaders/%s.comp\n   sources: sha256 %s\n   %d words */\n' "$1" "$hash" $((bytes / 4))
    printf 'static const uint32_t hyk_spirv_%s[] = {\n' "$1"
    od -An -v -w48 -tu4 "$2/$1.spv" | sed 's/^ *//; s/  */,/g; s/$/,/'
    printf '};\n'
}

all() { # folder: the whole output
    cat << C
/* >>vk-spirv: the kernels of shaders/ as SPIR-V words; made by \`make spirv\`, do not edit */
/* Compiled with $(tools).
   A kernel's hash is that of its source and all files it includes, put together in the order of their names. */
#ifndef HYI_VK_SPIRV_H
#define HYI_VK_SPIRV_H

#include <stdint.h>

/* Every kernel: its words are hyk_spirv_ and the name. */
#define HYI_VK_KERNELS(X) \\
$(printf '    X(%s) \\\n' $kernels | sed '$s/ \\$//')
C
    for name in $kernels; do kernel "$name" "$1" || return 1; done
    printf '\n#endif /* HYI_VK_SPIRV_H */\n'
}

kernels=$(printf '%s\n' *.comp | sed 's/\.comp$//')
[ "$kernels" != '*' ] || die "there are no kernels"
case $1 in
    --sources)
        for name in $kernels; do
            hash=$(hash_of "$name") || exit 1
            printf '%s %s\n' "$name" "$hash"
        done
        ;;
    --tools) tools ;;
    -*) die "no option $1" ;;
    *)
        tools > /dev/null || die "glslangValidator, spirv-opt and spirv-val are needed: Debian's glslang-tools and spirv-tools"
        scratch=$(mktemp -d) || exit 1
        trap 'rm -rf "$scratch"' EXIT
        export -f compile
        # shellcheck disable=SC2016
        printf '%s\n' $kernels | xargs -P "${JOBS:-2}" -I NAME bash -c 'compile NAME "$0"' "$scratch" || die "a kernel does not compile"
        all "$scratch" > "$scratch/spirv.h" || exit 1
        if cmp -s "$scratch/spirv.h" "$output"; then
            echo "${output##*/} is fresh"
        else
            mkdir -p "$(dirname "$output")" && cp "$scratch/spirv.h" "$output" && echo "made ${output##*/}"
        fi
        ;;
esac
