#!/usr/bin/env bash
# The graph at a small profile in a clone of the working tree; nothing here is touched.
#   tests/smoke/run.sh                        profile smoke with the studies, in a folder that is removed afterwards
#   tests/smoke/run.sh DIR                    the same in DIR, kept
#   tests/smoke/run.sh --profile demo DIR     the paper alone at profile demo
set -euo pipefail
unset $(git rev-parse --local-env-vars)  # of the hook or alias that started this: git and DVC would work on its repository
root=$(cd "$(dirname "$0")/../.." && pwd)
profile=smoke pipelines=-P left_out=()
if [ "${1:-}" = --profile ] && [ $# -eq 3 ]; then
  profile=$2 pipelines= left_out=(':!studies')
  shift 2
fi
python -c 'import pinocchio' 2> /dev/null || left_out+=(':!studies/execution')  # needs the extra robot
if [ $# -gt 1 ] || [[ "${1:-}" = -* ]]; then
  sed -n '2,5s/^# //p' "$0"
  exit 2
fi
if [ $# -gt 0 ]; then
  if [ -n "$(ls -A "$1" 2> /dev/null)" ] && [ "$(git -C "$1" config user.email)" != smoke@localhost ]; then
    echo "error: $1 holds something else than an earlier run: name another folder" >&2
    exit 2
  fi
  rm -rf "$1"
  mkdir -p "$1"
  clone=$(cd "$1" && pwd)
else
  clone=$(mktemp -d)
  trap 'rm -rf "$clone"' EXIT
fi
git -C "$root" ls-files -z --cached --others --exclude-standard -- ':!outputs' ':!reports' ':!dvc.lock' \
  ':!studies/dvc.lock' ':!studies/*/dvc.lock' ':!studies/*/index.html' ':!studies/*/figures/*' ':!studies/*/tables/*' \
  ':!studies/*/provenance.json' "${left_out[@]}" |
  (cd "$root" && while IFS= read -r -d '' f; do [ ! -e "$f" ] || printf '%s\0' "$f"; done) |
  (cd "$root" && tar --null -T - -cf -) | tar -C "$clone" -xf -
cd "$clone"
git init -q
# whatever the person's own configuration says: all files, no hooks, no key
for setting in user.name=smoke user.email=smoke@localhost commit.gpgSign=false core.excludesFile=/dev/null core.hooksPath=/dev/null; do
  git config "${setting%%=*}" "${setting#*=}"
done
git add -A && git commit -qm smoke
dvc pull --quiet --remote store data.dvc rendered/pictures.dvc
python -m pipeline.params "profile=$profile"
dvc repro $pipelines
git add -A && git commit -qm "$profile run"
test -s reports/index.html && test -s reports/metrics.json && test -s reports/recordings/recordings.csv
echo "$profile run complete: $(find outputs/record/runs -name '*.rrd' | wc -l) recordings, report of $(stat -c %s reports/index.html) bytes"
