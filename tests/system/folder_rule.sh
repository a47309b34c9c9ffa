#!/usr/bin/env bash
# The folder rule: core ← acquisition, centroiding, reconstruct, detect ← service ← tests, the rooms
# inside them, and the outside libraries that have one place each. It checks the checkout in which
# it lies, or the folder that it is given.
set -euo pipefail
cd "${1:-$(dirname "$0")/../..}"
bad=0
report() { # report <rule> <lines that break it>
  [ -z "$2" ] && return
  printf 'folder rule: %s\n%s\n' "$1" "$2"
  bad=1
}
includes() { grep -rnE "#include [\"<]($1)" "${@:2}" --include='*.h' --include='*.cpp' || true; }
stages=(acquisition centroiding reconstruct detect service)

for folder in core acquisition centroiding reconstruct detect; do
  report "$folder/ includes core/ and itself only" \
    "$(includes '(core|acquisition|centroiding|reconstruct|detect|service|tests)/' "$folder" |
      grep -vE "#include \"(core|$folder)/" || true)"
done
report 'service/ does not include tests/' "$(includes 'tests/' service)"
report 'only training/ and commands/ include bench/' \
  "$(includes 'service/bench/' service | grep -vE '^service/(bench|training|commands)/' || true)"
report 'only commands/ includes training/' \
  "$(includes 'service/training/' service | grep -vE '^service/(training|commands)/' || true)"
report 'nothing but main.cpp includes commands/' \
  "$(includes 'service/commands/' service | grep -vE '^service/(commands/|main\.cpp:)' || true)"
report 'core/ includes std, Eigen and the queue only' \
  "$(includes '(fitsio|spdlog|CLI|toml|nlohmann|hwy|libusb|arv|kiss)' core)"
report 'the moodycamel queue in core/slot_queue.h only' \
  "$(includes 'concurrentqueue' core "${stages[@]}" | grep -v '^core/slot_queue.h:' || true)"
# A library has one room. Of the headers there only one may include it, the handle that the room's
# own files share.
library() { # library <name> <header> <room>
  report "$1 in acquisition/$3/ only, and there in *.cpp and ${3}_handle.h" \
    "$(includes "$2" core "${stages[@]}" |
      grep -vE "^acquisition/$3/([a-z_]+\.cpp|$3_handle\.h):" || true)"
}
library cfitsio 'fitsio' fits
library libpng 'png\.h' pictures
library libtiff 'tiffio' pictures
library Aravis 'arv\.h' aravis
library libusb 'libusb' usb
report 'spdlog in service/ and acquisition/**.cpp only' \
  "$(includes 'spdlog' core "${stages[@]}" |
    grep -vE '^(service/|acquisition/[a-z_/]+\.cpp:)' || true)"
report 'no two files have one name' \
  "$(find core "${stages[@]}" tests -name '*.h' -o -name '*.cpp' | sed 's|.*/||' | sort | uniq -d)"
report 'docs/architecture.md lists every room, and no room that is not there' \
  "$(diff <(find core "${stages[@]}" -name '*.cpp' -printf '%h/\n' | sort -u) \
      <(sed -nE 's/^\| `((core|acquisition|centroiding|reconstruct|detect|service)\/[a-z_\/]*)` \|.*/\1/p' \
        docs/architecture.md | sort -u) || true)"
exit $bad
