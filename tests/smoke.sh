#!/usr/bin/env bash
# The whole real graph at profile=smoke, in a throwaway clone of the working tree; nothing here is touched.
set -euo pipefail
root=$(cd "$(dirname "$0")/.." && pwd)
clone=$(mktemp -d)
trap 'rm -rf "$clone"' EXIT
git -C "$root" ls-files -z --cached --others --exclude-standard |
  (cd "$root" && while IFS= read -r -d '' f; do [ -e "$f" ] && printf '%s\0' "$f"; done) |
  (cd "$root" && tar --null -T - -cf -) | tar -C "$clone" -xf -
cd "$clone"
git init -q && git add -A && git -c user.name=smoke -c user.email=smoke@localhost commit -qm smoke
dvc pull --quiet data.dvc
python -m pipeline.params profile=smoke
dvc repro "$@"
[ -z "$(dvc status -q || echo stale)" ] || { echo "error: dvc finds the smoke run stale right after it" >&2; exit 1; }
test -s reports/index.html && test -s reports/metrics.json && test -s outputs/record/recordings.csv
echo "smoke run complete: $(find outputs/record/runs -name '*.rrd' | wc -l) recordings, report of $(stat -c %s reports/index.html) bytes"
