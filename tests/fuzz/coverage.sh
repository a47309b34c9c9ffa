#!/usr/bin/env bash
# Prints how many lines of each parser its fuzzer reaches with the seeds and with what ./dev fuzz has
# kept. Called by ./dev fuzz --coverage: coverage.sh BUILD CORPUS. What a fuzzer does in the process
# that unpacks compressed pixels does not count.
set -euo pipefail
cd "$(dirname "$0")/../.."
build=$1
corpus=$2

parsers() {
  case "$1" in
    fuzz_config) echo service/config.cpp ;;
    fuzz_control) echo service/daemon/control_socket.cpp ;;
    fuzz_dark) echo acquisition/recording/mean_image.cpp ;;
    fuzz_frame_numbers) echo acquisition/frame_numbering.h ;;
    fuzz_genicam) echo acquisition/aravis/genicam_description.cpp ;;
    fuzz_header) echo acquisition/fits/{fits_card,header_check,table_check}.cpp ;;
    fuzz_http) echo service/http/http_request.cpp ;;
    fuzz_milk_times) echo acquisition/recording/milk_recording.cpp ;;
    fuzz_pictures) echo acquisition/pictures/{npy,png,tiff}_file.cpp ;;
    fuzz_recording)
      echo acquisition/recording/{fits_cube,fits_source,frame_hdus,pixel_range}.cpp \
        acquisition/fits/{fits_reading,gzip_file,hdu_bytes,plain_pixels,raw_header}.cpp ;;
    fuzz_sensor) echo service/sensor/sensor_{file,check}.cpp centroiding/pixel_response.cpp ;;
    fuzz_usb_frames) echo acquisition/usb/usb_frame_assembler.cpp ;;
    *) echo "coverage.sh: name the parsers of $1" >&2; exit 1 ;;
  esac
}

printf '%-20s %7s  %-45s %6s %6s\n' harness inputs parser lines covered
for source in tests/fuzz/fuzz_*.cpp; do
  name=$(basename "$source" .cpp)
  program=$build/tests/fuzz/$name
  inputs=()
  for folder in "tests/fuzz/seeds/$name" "$corpus/$name"; do
    [ ! -d "$folder" ] || inputs+=("$folder")
  done
  LLVM_PROFILE_FILE=$build/$name.profraw "$program" -runs=0 "${inputs[@]}" >"$build/$name.log" 2>&1 ||
    { tail -n 30 "$build/$name.log"; exit 1; }
  llvm-profdata merge -sparse "$build/$name.profraw" -o "$build/$name.profdata"
  # shellcheck disable=SC2046
  llvm-cov export -summary-only -instr-profile "$build/$name.profdata" "$program" $(parsers "$name") |
    "${PYTHON:-python3}" -c '
import json, os, sys
harness, inputs = sys.argv[1:]
for file in json.load(sys.stdin)["data"][0]["files"]:
    lines = file["summary"]["lines"]
    name = os.path.relpath(file["filename"])
    print("%-20s %7s  %-45s %6d %6d" % (harness, inputs, name, lines["count"], lines["covered"]))
' "$name" "$(find "${inputs[@]}" -type f | wc -l)"
done
