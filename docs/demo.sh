#!/usr/bin/env bash
# The demo simulates a beam with vortices, calibrates the sensor on a plane wave, replays the beam
# and draws one frame. Run it with ./dev demo.
set -euo pipefail
curlew=${CURLEW:-build/release/curlew}
out=${1:-demo}
mkdir -p "$out"
rm -f "$out"/{reference,sensor,beam,results}.fits "$out"/{vortices.jsonl,frame.png,report.html}

run() {
  printf '\n$ curlew %s\n' "$*"
  "$curlew" "$@"
}

sensor=(--rows 20 --cols 20 --window 8 --pupil obscured --obscuration 0.25 --read-noise 2 --bits 14)
run simulate --preset plane "${sensor[@]}" --photons 10000 --frames 50 --seed 1 --out "$out/reference.fits"
run calibrate "$out/reference.fits" --out "$out/sensor.fits"
run simulate --preset vortex "${sensor[@]}" --photons 3000 --amplitude linear --core-radius 1.5 \
  --zernike 6:0.8 --zernike 8:0.5 \
  --vortex 4.3,6.6,+1 --vortex 14.2,4.4,-1 --vortex 15.2,12.1,+1 --vortex 6.9,14.5,-1 \
  --velocity 0.004,0.002 --frames 100 --seed 2 --out "$out/beam.fits"
run replay "$out/beam.fits" --sensor "$out/sensor.fits" --out "$out/results.fits" \
  --save slopes,flux,phase,solenoidal,circulation --jsonl "$out/vortices.jsonl" \
  --picture 0:"$out/frame.png" --report "$out/report.html"
