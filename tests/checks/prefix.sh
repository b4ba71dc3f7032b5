#!/bin/bash
# No name of ours without a prefix of ours: macros, typedefs, tags, enumerators, functions, variables, symbols of
# the object. No mutable global data. No call of the C library that prints, opens files, exits or has hidden state,
# and no function of Vulkan that would have to be linked. The check proves itself on headers with bad names planted.
. "$(dirname "$0")/common.sh"
header=${HYDRA_HEADER:-$PWD/hydra.h} vk_header=${HYDRA_VK_HEADER:-$PWD/hydra_vk.h}
for file in "$header" "$vk_header"; do [ -f "$file" ] || { wrong "$file is missing"; finish; }; done
prefix='^(hydra|HYDRA|hyi|HYI|hyk|HYK)_'
vk_prefix='^(hydra_vk_|HYDRA_VK_|hyi_vk(_|$)|HYI_VK_|hyk_|HYK_)'
# Guarded, and asked of the system's or Vulkan's headers, not of the user: see where they are defined. The first is in
# the document of hydra_vk.h.
allowed='^(HYDRA_IMPLEMENTATION|_POSIX_C_SOURCE|_DEFAULT_SOURCE|WIN32_LEAN_AND_MEAN|NOMINMAX|VK_NO_PROTOTYPES)$'
forbidden='^(printf|puts|putchar|perror|fopen|fopen64|open|open64|fprintf|exit|_exit|abort|__assert_fail|rand|srand|random|drand48|strtok|setlocale|signal|getenv|system|vk[A-Z].*)$'

unit() { # hydra.h, hydra_vk.h or nothing: a source file with the implementation
    printf '#define HYDRA_IMPLEMENTATION\n#include "%s"\n' "$1"
    [ -z "${2-}" ] || printf '#define HYDRA_VK_IMPLEMENTATION\n#include "%s"\n' "$2"
}

# Every macro that the text defines in any branch, and every one that the preprocessor sees come from it.
macros() { # header, the header before it or nothing
    sed -nE 's/^[ \t]*#[ \t]*define[ \t]+([A-Za-z_0-9]+).*/\1/p' "$1"
    for flags in "" "-DHYDRA_IMPLEMENTATION -DHYDRA_VK_IMPLEMENTATION"; do
        printf '#include "%s"\n' ${2:+"$2"} "$1" | $CC -std=c99 $flags "-I$PWD" -E -dD -x c - | awk -v file="\"$1\"" '
            /^# [0-9]+ / { here = $3 == file }
            here && /^#define / { sub(/\(.*/, "", $2); print $2 }'
    done
}

# Names at file scope, from the debug information: entries one level below the unit (enumerators two) that are
# declared in one of the headers, each after that header's name.
scope() { # hydra.h, hydra_vk.h, name of scratch files
    unit "$1" "$2" > "$scratch/$3.c"
    $CC -std=c99 -O0 -gdwarf-4 -g3 -fno-eliminate-unused-debug-types -fno-eliminate-unused-debug-symbols -fkeep-inline-functions \
        -fkeep-static-functions "-I$PWD" -c "$scratch/$3.c" -o "$scratch/$3.o" || return 1
    local numbers
    numbers=$(objdump --dwarf=rawline "$scratch/$3.o" | awk -v names=" ${1##*/} ${2##*/} " '
        /The File Name Table/ { on = 1 } on && index(names, " " $NF " ") { print $1 "=" $NF }')
    objdump --dwarf=info "$scratch/$3.o" | awk -v numbers="$(tr '\n' ' ' <<< "$numbers")" '
        function enumeration() { return level == 2 && tag ~ /enumerator/ }
        function done() { if (name != "" && (decl in file) && (level == 1 || enumeration())) print file[decl], name }
        BEGIN { count = split(numbers, pair, " "); for (i = 1; i <= count; i++) { split(pair[i], part, "="); file[part[1]] = part[2] } }
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

# All names of both headers, each after its header's name: in the file scratch/name.names.
names() { # hydra.h, hydra_vk.h, name
    {
        macros "$1" | sed "s/^/${1##*/} /"
        macros "$2" "$1" | sed "s/^/${2##*/} /"
        scope "$1" "$2" "$3"
    } | sort -u > "$scratch/$3.names"
}
of() { sed -n "s/^${1##*/} //p" "$scratch/$2.names"; } # header, name
bad() { of "$1" "$3" | grep -vE "$2|$allowed"; }       # header, its prefixes, name

# ---- the headers

names "$header" "$vk_header" plain
for name in $(bad "$header" "$prefix" plain) $(bad "$vk_header" "$vk_prefix" plain); do wrong "no prefix: $name"; done
count=$(of "$header" plain | wc -l) vk_count=$(of "$vk_header" plain | wc -l)
[ "$count" -gt 300 ] && [ "$vk_count" -gt 100 ] || wrong "only $count and $vk_count names found: the check has lost its eyes"

object() { # name, headers: compiles them
    unit "${@:2}" > "$scratch/$1.c"
    $CC -std=c99 -O0 -fno-pic -fno-pie "-I$PWD" ${flags-} -c "$scratch/$1.c" -o "$scratch/$1.o" || wrong "does not compile: $1"
}
symbols() { nm "$scratch/$1.o" | awk -v kinds="$2" '$(NF - 1) ~ "^[" kinds "]$" { print $NF }'; }
external=ABCDGRSTVW data=BbCDdGgSs
object unit "$header"
object both "$header" "$vk_header"
flags="-DHYDRA_STATIC -w" object static "$header" "$vk_header"
for name in $(symbols unit $external | grep -vE '^hydra_' || true) $(symbols unit $external | grep -E '^hydra_vk_'); do
    wrong "external, but not hydra_: $name"
done
for name in $(comm -13 <(symbols unit $external | sort) <(symbols both $external | sort) | grep -vE '^hydra_vk_'); do
    wrong "external, but not hydra_vk_: $name"
done
for name in $(symbols static $external); do wrong "external in spite of HYDRA_STATIC: $name"; done
for name in $(symbols both $data); do wrong "a global variable: $name"; done
for name in $(symbols both U | grep -E "$forbidden"); do wrong "calls $name"; done

# Every function that an API declares is defined, and the other way round.
declared() { # header
    sed '/end of the API/,$d' "$1" | grep -oE '^HYDRA_API [^(]*hydra_[a-z0-9_]+\(' | grep -oE 'hydra_[a-z0-9_]+\($' | tr -d '(' | sort -u
}
symbols unit T | sort -u > "$scratch/defined"
comm -13 "$scratch/defined" <(symbols both T | sort -u) > "$scratch/vk_defined"
for api in "$header $scratch/defined" "$vk_header $scratch/vk_defined"; do
    [ "$(declared "${api% *}" | wc -l)" -gt 3 ] || wrong "${api% *} declares nothing: the check has lost its eyes"
    for name in $(comm -23 <(declared "${api% *}") "${api#* }"); do wrong "declared, not defined: $name"; done
    for name in $(comm -13 <(declared "${api% *}") "${api#* }"); do wrong "defined, not declared: $name"; done
done

# ---- the check itself: each planted name must be found

plants() { # suffix of the names, a name's prefix that is fine
    cat << C
#define bad_macro$1 1
#if 0
#define bad_hidden_macro$1 1
#endif
typedef int bad_type$1;
struct bad_tag$1 { int member; };
enum bad_enum$1 { BAD_ENUMERATOR$1, $2_good_enumerator };
typedef enum { BAD_ANONYMOUS$1 } $2_good_enum;
union bad_union$1 { int member; };
static int bad_function$1(int parameter) { int local = parameter; return local; }
static inline int bad_inline$1(void) { return 1; }
int bad_external$1(void);
int bad_external$1(void) { return bad_function$1(1) + bad_inline$1(); }
static const int bad_table$1[2] = {1, 2};
C
}
plant() { # header, suffix, prefix, planted header
    plants "$2" "$3" > "$scratch/plants"
    awk -v plants="$scratch/plants" '{ print } /end of the API/ && !done { while ((getline line < plants) > 0) print line; done = 1 }' "$1" > "$4"
}
plant "$header" "" hydra "$scratch/planted.h"
plant "$vk_header" _too hydra_vk "$scratch/planted_vk.h"
echo 'typedef int hyi_not_of_vk;' >> "$scratch/planted_vk.h"
names "$PWD/$scratch/planted.h" "$PWD/$scratch/planted_vk.h" planted
found=$(bad planted.h "$prefix" planted; bad planted_vk.h "$vk_prefix" planted)
for name in bad_macro bad_hidden_macro bad_type bad_tag bad_enum BAD_ENUMERATOR BAD_ANONYMOUS bad_union bad_function bad_inline bad_external bad_table; do
    for name in $name ${name}_too; do grep -qx "$name" <<< "$found" || wrong "planted, but not found: $name"; done
done
grep -qx hyi_not_of_vk <<< "$found" || wrong "planted, but not found: hyi_not_of_vk"
for name in member local parameter hydra_good_enumerator hydra_good_enum hydra_vk_good_enumerator hydra_vk_good_enum; do
    grep -qx "$name" <<< "$found" && wrong "innocent, but found: $name"
done
finish "$count and $vk_count names"
