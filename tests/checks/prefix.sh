#!/bin/bash
# No name of ours without a prefix of ours: macros, typedefs, tags, enumerators, functions, variables, symbols of
# the object. No mutable global data. No call of the C library that prints, opens files, exits or has hidden state.
# The check proves itself on a header with bad names planted.
. "$(dirname "$0")/common.sh"
header=${HYDRA_HEADER:-$PWD/hydra.h}
[ -f "$header" ] || { wrong "$header is missing"; finish; }
prefix='^(hydra|HYDRA|hyi|HYI|hyk|HYK)_'
# Guarded, and asked of the system's headers, not of the user: see where they are defined.
allowed='^(_POSIX_C_SOURCE|WIN32_LEAN_AND_MEAN|NOMINMAX)$'
forbidden='^(printf|puts|putchar|perror|fopen|fopen64|open|open64|fprintf|exit|_exit|abort|__assert_fail|rand|srand|random|drand48|strtok|setlocale|signal|getenv|system)$'

unit() { # header, extra macros: a source file with the implementation
    printf '#define HYDRA_IMPLEMENTATION\n#include "%s"\n' "$1"
}

# Every macro that the text defines in any branch, and every one that the preprocessor sees come from it.
macros() { # header
    sed -nE 's/^[ \t]*#[ \t]*define[ \t]+([A-Za-z_0-9]+).*/\1/p' "$1"
    for flags in "" -DHYDRA_IMPLEMENTATION; do
        printf '#include "%s"\n' "$1" | $CC -std=c99 $flags -E -dD -x c - | awk -v file="\"$1\"" '
            /^# [0-9]+ / { here = $3 == file }
            here && /^#define / { sub(/\(.*/, "", $2); print $2 }'
    done
}

# Names at file scope, from the debug information: entries one level below the unit (enumerators two) that are
# declared in the header.
scope() { # header, name of scratch files
    unit "$1" > "$scratch/$2.c"
    $CC -std=c99 -O0 -gdwarf-4 -g3 -fno-eliminate-unused-debug-types -fno-eliminate-unused-debug-symbols -fkeep-inline-functions \
        -fkeep-static-functions -c "$scratch/$2.c" -o "$scratch/$2.o" || return 1
    local number
    number=$(objdump --dwarf=rawline "$scratch/$2.o" | awk -v name="$(basename "$1")" '
        /The File Name Table/ { on = 1 } on && $NF == name { print $1; exit }')
    objdump --dwarf=info "$scratch/$2.o" | awk -v file="$number" '
        function done() { if (name != "" && decl == file && (level == 1 || (level == 2 && tag ~ /enumerator/))) print name }
        function enumeration() { return level == 2 && tag ~ /enumerator/ }
        /^ *<[0-9a-f]+><[0-9a-f]+>: Abbrev/ {
            done()
            split($1, part, /[<>]/); level = part[2]; tag = $0; name = ""
            if (!enumeration()) decl = ""
            else decl = outer
            next
        }
        /DW_AT_name/ { name = $NF }
        /DW_AT_decl_file/ { decl = $NF; if (level == 1) outer = $NF }
        END { done() }'
}

names() { { macros "$1"; scope "$1" "$2"; } | sort -u | grep -vE "$prefix|$allowed"; }

# ---- the header

bad=$(names "$header" plain)
for name in $bad; do wrong "no prefix: $name"; done
count=$({ macros "$header"; scope "$header" plain; } | sort -u | wc -l)
[ "$count" -gt 300 ] || wrong "only $count names found: the check has lost its eyes"

symbols() { nm "$1" | awk -v kinds="$2" '$(NF - 1) ~ "^[" kinds "]$" { print $NF }'; }
unit "$header" > "$scratch/unit.c"
$CC -std=c99 -O0 -fno-pic -fno-pie -c "$scratch/unit.c" -o "$scratch/unit.o" || wrong "does not compile"
$CC -std=c99 -O0 -fno-pic -fno-pie -DHYDRA_STATIC -c "$scratch/unit.c" -o "$scratch/static.o" 2> /dev/null || wrong "does not compile with HYDRA_STATIC"
for name in $(symbols "$scratch/unit.o" ABCDGRSTVW | grep -vE '^hydra_'); do wrong "external, but not hydra_: $name"; done
for name in $(symbols "$scratch/static.o" ABCDGRSTVW); do wrong "external in spite of HYDRA_STATIC: $name"; done
for name in $(symbols "$scratch/unit.o" BbCDdGgSs); do wrong "a global variable: $name"; done
for name in $(symbols "$scratch/unit.o" U | grep -E "$forbidden"); do wrong "calls $name"; done

# Every function that the API declares is defined, and the other way round.
sed '/end of the API/,$d' "$header" | grep -oE '^HYDRA_API [^(]*hydra_[a-z0-9_]+\(' | grep -oE 'hydra_[a-z0-9_]+\($' | tr -d '(' | sort -u > "$scratch/declared"
symbols "$scratch/unit.o" T | sort -u > "$scratch/defined"
for name in $(comm -23 "$scratch/declared" "$scratch/defined"); do wrong "declared, not defined: $name"; done
for name in $(comm -13 "$scratch/declared" "$scratch/defined"); do wrong "defined, not declared: $name"; done

# ---- the check itself: each planted name must be found

cat > "$scratch/plants" <<'C'
#define bad_macro 1
#if 0
#define bad_hidden_macro 1
#endif
typedef int bad_type;
struct bad_tag { int member; };
enum bad_enum { BAD_ENUMERATOR, hydra_good_enumerator };
typedef enum { BAD_ANONYMOUS } hydra_good_enum;
union bad_union { int member; };
static int bad_function(int parameter) { int local = parameter; return local; }
static inline int bad_inline(void) { return 1; }
int bad_external(void);
int bad_external(void) { return bad_function(1) + bad_inline(); }
static const int bad_table[2] = {1, 2};
C
awk -v plants="$scratch/plants" '{ print } /end of the API/ && !done { while ((getline line < plants) > 0) print line; done = 1 }' \
    "$header" > "$scratch/planted.h"
found=$(names "$PWD/$scratch/planted.h" planted)
for name in bad_macro bad_hidden_macro bad_type bad_tag bad_enum BAD_ENUMERATOR BAD_ANONYMOUS bad_union bad_function bad_inline bad_external bad_table; do
    grep -qx "$name" <<< "$found" || wrong "planted, but not found: $name"
done
for name in member local parameter hydra_good_enumerator hydra_good_enum; do
    grep -qx "$name" <<< "$found" && wrong "innocent, but found: $name"
done
finish "$count names"
