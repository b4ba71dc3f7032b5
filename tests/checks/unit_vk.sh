#!/bin/bash
# The unit tests on Vulkan: those of the API in one process, and each subject about Vulkan alone in one of its own, for
# these make many instances, of which version 1.3.239 of the validation layer bears only so many beside each other: it
# then crashes in vkCreateDevice. The last line counts them all.
#
#     unit_vk.sh PROGRAM SUBJECT...
program=$1 passed=0 failed=0 status=0
shift
common=() alone=()
for subject; do [[ $subject == vk_* ]] && alone+=("$subject") || common+=("$subject"); done

run() { # subjects
    local log counts
    log=$(mktemp) || exit 1
    "$program" "$@" | tee "$log"
    [ "${PIPESTATUS[0]}" -eq 0 ] || status=1
    counts=$(grep -E '^[0-9]+ passed, [0-9]+ failed$' "$log" | tail -n 1)
    grep -q '^no Vulkan loader' "$log" && counts="0 passed, 0 failed"
    rm -f "$log"
    passed=$((passed + $(cut -d' ' -f1 <<< "${counts:-0}"))) failed=$((failed + $(cut -d' ' -f3 <<< "${counts:-0 0 1}")))
}

[ ${#common[@]} -eq 0 ] || run "${common[@]}"
for subject in "${alone[@]}"; do run "$subject"; done
echo "$passed passed, $failed failed"
[ $status -eq 0 ] && [ $failed -eq 0 ]
