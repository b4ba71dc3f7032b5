#!/bin/bash
# The whole of `make test`: every stage, its time, and on the last line how many tests passed and failed. The unit
# tests count one each, on the processor and on Vulkan; a check, a sanitizer run, the README's program and each example
# count as one test.
#
# As many stages run side by side as there are jobs, the longest first: most of them keep one core busy, so that this
# fills two where make -j alone would not. Seconds are those of the clock and, after them, of the processor.
set -u
cd "$(dirname "$0")/../.." || exit 1
export LC_ALL=C
: "${MAKE:=make}" "${JOBS:=2}"
unset MAKEFLAGS MFLAGS
logs=build/log
rm -rf "$logs"
mkdir -p "$logs"
started=$SECONDS

# Runs a goal of the Makefile; says in one go how it went, what it left out, and the end of its output if it failed.
stage() { # goal
    local log=$logs/${1##*/}.log status
    [ "$1" = unit-vk ] && export HYDRA_TEST_QUICK=1
    TIMEFORMAT='%R %U %S'
    { time "$MAKE" --no-print-directory -j"$inner" JOBS="$inner" "$1" > "$log" 2>&1; } 2> "$log.time"
    status=$?
    echo $status > "$log.status"
    printf '%s\n' "$(
        printf '%-24s %s' "$1" "$([ $status -eq 0 ] && echo ok || echo FAILED)"
        awk '{ printf " %4.0f s %4.0f s\n", $1, $2 + $3 }' "$log.time"
        grep -E '^note: |^no Vulkan loader|^on Vulkan: |^[0-9]+ validation messages' "$log" | sed 's/^/  /'
        if [ $status -ne 0 ]; then
            grep -B 2 -E '\] --- |\[  FAILED|FAILED |error:|ERROR:|warning:|runtime error|SUMMARY|: [0-9]+ wrong|no prefix|stale|missing|\*\*\*|VUID-|SYNC-HAZARD' "$log" |
                grep -vE '^--$|\[ RUN|\[  +OK|test\(s\)|TEST\(S\)' | awk '!seen[$0]++' | head -n 40
            echo "  ... the whole of it is in $log"
        fi
    )"
}
export -f stage
inner=$((JOBS > 2 ? 2 : 1))
export MAKE logs inner

stages=(unit-vk test-asan test-tsan unit test-fast check-matrix ${EXAMPLES-} check-shared check-prefix test-readme check-generated)
printf '%s\n' "${stages[@]}" | xargs -P "$JOBS" -I GOAL bash -c 'stage GOAL'

passed=0 failed=0 bad=()
for goal in "${stages[@]}"; do
    log=$logs/${goal##*/}.log
    status=$(cat "$log.status" 2> /dev/null || echo 1)
    [ "$status" -eq 0 ] || bad+=("$goal")
    case $goal in
        unit | unit-vk)
            sed -n '/^subject .*seconds$/,/ passed, /p' "$log" | sed "1s/^subject */$(printf '%-27s' "$goal")/"
            counts=$(grep -E '^[0-9]+ passed, [0-9]+ failed$' "$log" | tail -n 1)
            wrong=$(cut -d' ' -f3 <<< "$counts")
            # Without a count it did not get there; with a count of none failed, the count hides something.
            [ "$status" -eq 0 ] || [ "${wrong:-0}" -ne 0 ] || wrong=1
            passed=$((passed + $(cut -d' ' -f1 <<< "${counts:-0}"))) failed=$((failed + ${wrong:-1}))
            ;;
        *) if [ "$status" -eq 0 ]; then passed=$((passed + 1)); else failed=$((failed + 1)); fi ;;
    esac
done

echo "total $((SECONDS - started)) s"
[ ${#bad[@]} -eq 0 ] || echo "failed: ${bad[*]}"
echo "$passed passed, $failed failed" | tee "$logs/summary"
[ "$failed" -eq 0 ] && [ ${#bad[@]} -eq 0 ]
