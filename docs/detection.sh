#!/usr/bin/env bash
# Measures again the main tables of docs/lab/detection.md and the values of docs/paper.md. That takes
# half an hour on two cores. Most of it is simulating turbulence, which is kept for the next time.
# --quick shows in a minute or two that all of it runs. Run it with ./dev detection.
set -euo pipefail
cd "$(dirname "$0")/.."
curlew=${CURLEW:-build/release/curlew}
python=${PYTHON:-/usr/bin/python3}
quick=()
[ "${1:-}" = --quick ] && { quick=(--quick); shift; }
out=${1:-detection}
mkdir -p "$out"

measure() {  # measure <name> <command…>: prints what the command says, and keeps it
  local name=$1
  shift
  printf '\n$ %s\n' "$*"
  "$@" | tee "$out/$name.txt"
}

bench=("$curlew" bench)
measure detect "${bench[@]}" detect "${quick[@]}"
for pupil in round obscured; do
  measure "detect_$pupil" "${bench[@]}" detect --pupil "$pupil" --faded 0.05 --rytov 2 "${quick[@]}"
done
measure detect_weighted "${bench[@]}" detect --centroid weighted --rytov 2 "${quick[@]}"
# These have what the classifier was not taught: other lenslets, windows, samplings and fluxes.
some=(--realisations 24 --validation 24)
[ ${#quick[@]} -gt 0 ] && some=(--quick)
measure detect_lenslet "${bench[@]}" detect --lenslet 0.1 --rytov 2 --photons 1000 "${some[@]}"
measure detect_window "${bench[@]}" detect --window 8 --rytov 2 --photons 1000 "${some[@]}"
measure detect_sampling "${bench[@]}" detect --window 10 --sampling 3 --rytov 3 --photons 500 "${some[@]}"
# These have what real benches do to the laboratory's frames.
field=(--realisations 50 --validation 30)
[ ${#quick[@]} -gt 0 ] && field=(--realisations 1 --validation 1)
measure detect_field "${bench[@]}" detect --field "${field[@]}"
measure false_alarms "${bench[@]}" false-alarms "${quick[@]}"
measure classifier "${bench[@]}" classifier $([ ${#quick[@]} -gt 0 ] && echo --repeats 20)
measure bound "${bench[@]}" bound "${quick[@]}"
measure track "${bench[@]}" track "${quick[@]}"
measure phase "${bench[@]}" phase "${quick[@]}"
measure paper "$python" docs/paper_figures.py "$curlew" "$out/paper" "${quick[@]}"
