#!/bin/bash
# The whole of `make test`: every stage, its time, and on the last line how many tests passed and failed. The unit
# tests count one each; a check, a sanitizer run, the README's program and each example count as one test.
set -u
cd "$(dirname "$0")/../.." || exit 1
export LC_ALL=C
: "${MAKE:=make}" "${JOBS:=2}"
unset MAKEFLAGS MFLAGS
logs=build/log
rm -rf "$logs"
mkdir -p "$logs"
passed=0 failed=0 started=$SECONDS
bad=()

# Runs a goal of the Makefile; prints one line, and the end of its output if it failed.
stage() { # goal, variables
    local log=$logs/${1##*/}.log from=$SECONDS status
    "$MAKE" --no-print-directory -j"$JOBS" "$@" > "$log" 2>&1
    status=$?
    printf '%-24s %s %4d s\n' "$1" "$([ $status -eq 0 ] && echo ok || echo FAILED)" $((SECONDS - from))
    [ $status -eq 0 ] && return 0
    bad+=("$1")
    grep -B 2 -E '\] --- |\[  FAILED|FAILED |error:|ERROR:|warning:|runtime error|SUMMARY|: [0-9]+ wrong|no prefix|stale|missing|\*\*\*' "$log" |
        grep -vE '^--$|\[ RUN|\[  +OK|test\(s\)|TEST\(S\)' | awk '!seen[$0]++' | head -n 40
    echo "  ... the whole of it is in $log"
    return 1
}

one() { if stage "$@"; then passed=$((passed + 1)); else failed=$((failed + 1)); fi; }

for check in check-generated check-prefix check-shared check-matrix; do one $check; done

stage unit
counts=$(grep -E '^[0-9]+ passed, [0-9]+ failed$' $logs/unit.log | tail -n 1)
if [ -n "$counts" ]; then
    sed -n '/^subject .*seconds$/,/ passed, /p' $logs/unit.log
    passed=$((passed + $(cut -d' ' -f1 <<< "$counts"))) failed=$((failed + $(cut -d' ' -f3 <<< "$counts")))
fi
# It did not get to its count, or the count hides something: that is one failure more.
if [ -z "$counts" ] || { [[ " ${bad[*]-} " == *" unit "* ]] && [ "$(cut -d' ' -f3 <<< "$counts")" -eq 0 ]; }; then failed=$((failed + 1)); fi

# Both sanitizers side by side: their programs run in one thread for most of the time.
stage test-asan &
asan=$!
stage test-tsan &
tsan=$!
for run in "$asan test-asan" "$tsan test-tsan"; do
    if wait "${run% *}"; then passed=$((passed + 1)); else failed=$((failed + 1)) bad+=("${run#* }"); fi
done
one test-readme
for example in ${EXAMPLES-}; do one "$example"; done

echo "total $((SECONDS - started)) s"
[ ${#bad[@]} -eq 0 ] || echo "failed: ${bad[*]}"
echo "$passed passed, $failed failed" | tee "$logs/summary"
[ "$failed" -eq 0 ] && [ ${#bad[@]} -eq 0 ]
