#!/usr/bin/env bash
# The whole real graph at profile=smoke, in a throwaway clone of the working tree; nothing here is touched.
#   tests/smoke.sh          run, then remove the clone
#   tests/smoke.sh DIR      run in DIR, an empty directory, and keep it
set -euo pipefail
root=$(cd "$(dirname "$0")/.." && pwd)
if [ $# -gt 0 ]; then
  clone=$1
else
  clone=$(mktemp -d)
  trap 'rm -rf "$clone"' EXIT
fi
git -C "$root" ls-files -z --cached --others --exclude-standard -- ':!outputs' ':!reports' ':!dvc.lock' |
  (cd "$root" && while IFS= read -r -d '' f; do [ ! -e "$f" ] || printf '%s\0' "$f"; done) |
  (cd "$root" && tar --null -T - -cf -) | tar -C "$clone" -xf -
cd "$clone"
git init -q
git config user.name smoke
git config user.email smoke@localhost
git add -A && git commit -qm smoke
dvc pull --quiet data.dvc
python -m pipeline.params profile=smoke
dvc repro
git add -A && git commit -qm "smoke run"
test -s reports/index.html && test -s reports/metrics.json && test -s outputs/record/recordings.csv
echo "smoke run complete: $(find outputs/record/runs -name '*.rrd' | wc -l) recordings, report of $(stat -c %s reports/index.html) bytes"
