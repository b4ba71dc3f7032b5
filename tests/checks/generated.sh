#!/bin/bash
# hydra.h and hydra_vk.h are what their parts make, the lists of parts hold every file of src/ and shaders/shared/, and
# src/vk/spirv.h is what shaders/ compiles to. With other versions of the compiler than it was made with, the hashes of
# the sources are compared instead.
. "$(dirname "$0")/common.sh"
amalgamate=$scratch/amalgamate

$CC -std=c99 -O1 $warnings_c tools/amalgamate.c -o "$amalgamate" || { wrong "tools/amalgamate.c does not compile"; finish; }
"$amalgamate" --list | sort > "$scratch/listed"
# *.inc.h stand in the parts that include them: each must be included by one.
find src shaders/shared -name '*.h' ! -name '*.inc.h' | sort > "$scratch/there"
while read -r file; do
    grep -qF "#include \"${file##*/}\"" "${file%/*}"/*.h || wrong "$file is included by no part"
done < <(find src shaders/shared -name '*.inc.h')
while read -r file; do wrong "$file is not in the list of parts (tools/amalgamate.c)"; done < <(comm -13 "$scratch/listed" "$scratch/there")
while read -r file; do wrong "$file is listed but not there"; done < <(comm -23 "$scratch/listed" "$scratch/there")
while read -r file; do wrong "$file: hand-written host code is .h or nothing"; done < <(find src shaders/shared -type f ! -name '*.h')

while read -r file; do
    grep -qF "#include \"${file##*/}\"" shaders/*.comp shaders/*.glsl || wrong "$file is included by no kernel"
done < <(find shaders -maxdepth 1 -name '*.glsl')

for header in hydra.h hydra_vk.h; do
    option=
    [ $header = hydra_vk.h ] && option=--vk
    if ! "$amalgamate" $option "$scratch/$header"; then
        wrong "the parts do not make $header"
    elif ! [ -f $header ]; then
        wrong "$header is missing; run: make headers"
    elif ! cmp -s $header "$scratch/$header"; then
        diff $header "$scratch/$header" | cut -c 1-160 | head -n 10
        wrong "$header is stale; run: make headers"
    fi
done

# ---- SPIR-V

words=src/vk/spirv.h
made_with=$(sed -n 's|^/\* Compiled with \(.*\)\.$|\1|p' $words)
here=$(shaders/compile.sh --tools)
if [ "$made_with" = "$here" ]; then
    if ! shaders/compile.sh "$scratch/spirv.h" > /dev/null; then
        wrong "shaders/ does not compile"
    elif ! cmp -s $words "$scratch/spirv.h"; then
        wrong "$words is stale; run: make spirv headers"
    fi
    finish "SPIR-V recompiled"
else
    note "SPIR-V not recompiled, hashes of its sources compared: made with ${made_with:-an unknown compiler}, here is ${here:-none}"
    sed -n 's|^/\* shaders/\(.*\)\.comp$|\1|p; s|^ *sources: sha256 ||p' $words | paste -d ' ' - - > "$scratch/hashes"
    shaders/compile.sh --sources > "$scratch/sources" || wrong "shaders/ has no hashes"
    diff "$scratch/hashes" "$scratch/sources" > /dev/null || wrong "$words is stale; run: make spirv headers"
    finish
fi
