#!/bin/bash
# hydra.h is what its parts make, and the list of parts holds every file of src/ and shaders/shared/.
# (src/vk and entry points of shaders belong to hydra_vk.h.)
. "$(dirname "$0")/common.sh"
amalgamate=$scratch/amalgamate

$CC -std=c99 -O1 $warnings_c tools/amalgamate.c -o "$amalgamate" || { wrong "tools/amalgamate.c does not compile"; finish; }
"$amalgamate" --list | sort > "$scratch/listed"
# *.inc.h stand in the parts that include them: each must be included by one.
find src shaders/shared -name '*.h' ! -name '*.inc.h' ! -path 'src/vk/*' ! -path 'shaders/shared/vk/*' | sort > "$scratch/there"
while read -r file; do
    grep -qF "#include \"${file##*/}\"" "${file%/*}"/*.h || wrong "$file is included by no part"
done < <(find src shaders/shared -name '*.inc.h')
while read -r file; do wrong "$file is not in the list of parts (tools/amalgamate.c)"; done < <(comm -13 "$scratch/listed" "$scratch/there")
while read -r file; do wrong "$file is listed but not there"; done < <(comm -23 "$scratch/listed" "$scratch/there")
while read -r file; do wrong "$file: hand-written host code is .h or nothing"; done < <(find src shaders/shared -type f ! -name '*.h' ! -path '*/vk/*')

if "$amalgamate" "$scratch/hydra.h"; then
    if ! [ -f hydra.h ]; then
        wrong "hydra.h is missing; run: make hydra.h"
    elif ! cmp -s hydra.h "$scratch/hydra.h"; then
        diff hydra.h "$scratch/hydra.h" | head -n 10
        wrong "hydra.h is stale; run: make hydra.h"
    fi
else
    wrong "the parts do not make a header"
fi
finish
