# Sourced by the checks: the repository's root, a scratch folder, and the warning flags of the house.
set -u
export LC_ALL=C
cd "$(dirname "${BASH_SOURCE[0]}")/../.." || exit 1
check=$(basename "$0" .sh)
scratch=build/check/$check
rm -rf "$scratch"
mkdir -p "$scratch"
: "${CC:=gcc}" "${CXX:=g++}"

warnings="-Wall -Wextra -Wpedantic -Wconversion -Wsign-conversion -Wshadow -Wcast-qual -Wundef -Wdouble-promotion -Werror"
warnings_c="$warnings -Wstrict-prototypes -Wmissing-prototypes"

failures=0
wrong() { # a message: notes a failure
    printf '%s: %s\n' "$check" "$*"
    failures=$((failures + 1))
}
note() { # a message that `make test` shows as well: what was not checked here
    printf 'note: %s: %s\n' "$check" "$*"
}
finish() { # ends the check
    if [ "$failures" -eq 0 ]; then
        printf '%s: ok%s\n' "$check" "${1:+, $1}"
        exit 0
    fi
    printf '%s: %d wrong\n' "$check" "$failures"
    exit 1
}

# Runs "name|command" lines from standard input, as many at a time as there are processors; prints the output
# of those that fail, and notes each.
run_all() {
    export scratch
    local list=$scratch/jobs
    cat > "$list"
    local total
    total=$(wc -l < "$list")
    # shellcheck disable=SC2016
    tr '\n' '\0' < "$list" | xargs -0 -n 1 -P "${JOBS:-2}" bash -c '
        name=${0%%|*} log=$scratch/${0%%|*}.log
        log=${log// /_}
        if ! bash -c "${0#*|}" > "$log" 2>&1; then
            { printf "FAILED %s\n  %s\n" "$name" "${0#*|}"; grep -m 12 -E "error|warning|undefined|ERROR" "$log" || head -n 12 "$log"; } > "$log.failed"
        fi'
    for log in "$scratch"/*.failed; do
        [ -e "$log" ] || continue
        cat "$log"
        failures=$((failures + 1))
    done > "$scratch/failed"
    # One mistake breaks many jobs: each message once, and the command only of a job that has a new one.
    awk 'function known() { if (name != "" && command != "-") others = others " " name }
        /^FAILED / { known(); name = $2; command = ""; next }
        /^  / && command == "" { command = $0; next }
        { text = $0; sub(/^[^ ]*build\/check\/[^:]*:/, "", text); gsub(/,-W[a-z-]*/, "", text) }
        !seen[text]++ { if (command != "-") print "FAILED " name "\n" command; command = "-"; print }
        END { known(); if (others != "") print "FAILED for the same reasons:" others }' "$scratch/failed"
    jobs_run=$total
}
