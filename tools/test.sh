#!/usr/bin/env bash
# Runs tests/core in one process, tests/hard_cases in another, and every other test file in a process of
# its own (bpy keeps global state that a test file may not inherit), and sums up.
# usage: tools/test.sh [pytest arguments]
set -u -o pipefail
cd "$(dirname "$0")/.."
export OMP_WAIT_POLICY=passive
unset BLENDER_USER_RESOURCES PYTHONPATH
log=$(mktemp)
trap 'rm -f "$log"' EXIT
summary=()
status=0

run_tests() {  # targets, then pytest arguments; the first names them all
  local target=$1 code line
  printf '\n== %s\n' "$target"
  .venv/bin/python -m pytest "$@" </dev/null 2>&1 | tee "$log"
  code=$?
  # pytest's last line: "N passed, M skipped in S s". 5: no test of this file was selected.
  line=$(grep -E '^=*[ ]*[0-9]+ (passed|failed|error|skipped|deselected).* in ' "$log" | tail -n 1 | tr -d '=')
  [ "$code" = 0 ] || [ "$code" = 5 ] || { status=1; line="${line:-ended early} (exit $code)"; }
  [ "$code" = 5 ] || summary+=("$(printf '%-52s %s' "$target" "${line:-no summary}")")
}

run_tests "tests/core" tests/studies tests/command_line "$@"
run_tests tests/hard_cases "$@"
while IFS= read -r file; do
  run_tests "$file" "$@"
done < <(find tests -name 'test_*.py' -not -path 'tests/core/*' -not -path 'tests/studies/*' -not -path 'tests/command_line/*' -not -path 'tests/hard_cases/*' | sort)

printf '\n== Summary\n'
printf '%s\n' "${summary[@]:-no test was selected}"
exit "$status"
