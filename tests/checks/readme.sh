#!/bin/bash
# The README's first C program compiles without a warning and runs, word for word as it stands there.
. "$(dirname "$0")/common.sh"
[ -f README.md ] || { wrong "README.md is missing"; finish; }
awk '/^```c *$/ && !done { on = 1; next } /^```/ && on { on = 0; done = 1 } on' README.md > "$scratch/readme.c"
grep -q 'main *(' "$scratch/readme.c" || { wrong "README.md's first C block is no program"; finish; }
# examples/readme.c is the same program as a file, so that it can be edited where a compiler sees it.
if [ -f examples/readme.c ]; then
    diff examples/readme.c "$scratch/readme.c" || wrong "README.md and examples/readme.c differ"
fi
if $CC -std=c99 -O2 -Wall -Wextra -Werror -I. "$scratch/readme.c" -o "$scratch/readme" -lm -pthread; then
    (cd "$scratch" && timeout 120 ./readme > output.txt 2>&1)
    status=$?
    tail -n 5 "$scratch/output.txt"
    [ $status -eq 0 ] || wrong "the README's program ended with $status"
else
    wrong "the README's program does not compile"
fi
finish
