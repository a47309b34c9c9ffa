#!/usr/bin/env bash
# The folder rule: core ← acquisition, centroiding, reconstruct, detect ← service ← tests, and the
# outside libraries that have one place each.
set -euo pipefail
cd "$(dirname "$0")/../.."
bad=0
report() { # report <what> <lines>
  [ -z "$2" ] && return
  printf 'folder rule: %s\n%s\n' "$1" "$2"
  bad=1
}
includes() { grep -rnE "#include [\"<]($1)" "${@:2}" --include='*.h' --include='*.cpp' || true; }

for folder in core acquisition centroiding reconstruct detect; do
  report "$folder/ includes core/ and itself only" \
    "$(includes '(core|acquisition|centroiding|reconstruct|detect|service|tests)/' "$folder" |
      grep -vE "#include \"(core|$folder)/" || true)"
done
report 'service/ does not include tests/' "$(includes 'tests/' service)"
stages=(acquisition centroiding reconstruct detect service)
report 'core/ includes std, Eigen and the queue only' \
  "$(includes '(fitsio|spdlog|CLI|toml|nlohmann|hwy|libusb|arv|kiss)' core)"
report 'moodycamel in core/slot_queue.h only' \
  "$(includes 'concurrentqueue' core "${stages[@]}" | grep -v '^core/slot_queue.h:' || true)"
report 'cfitsio in acquisition/fits_*.cpp and fits_handle.h only' \
  "$(includes 'fitsio' core "${stages[@]}" |
    grep -vE '^acquisition/fits_([a-z]+\.cpp|handle\.h):' || true)"
report 'Aravis in acquisition/aravis_*.cpp and aravis_handle.h only' \
  "$(includes 'arv\.h' core "${stages[@]}" |
    grep -vE '^acquisition/aravis_([a-z_]+\.cpp|handle\.h):' || true)"
report 'libusb in acquisition/usb_*.cpp and usb_handle.h only' \
  "$(includes 'libusb' core "${stages[@]}" |
    grep -vE '^acquisition/usb_([a-z_]+\.cpp|handle\.h):' || true)"
report 'spdlog in service/ and acquisition/*.cpp only' \
  "$(includes 'spdlog' core "${stages[@]}" | grep -vE '^(service/|acquisition/[a-z_]+\.cpp:)' || true)"
exit $bad
