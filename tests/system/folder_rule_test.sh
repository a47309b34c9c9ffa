#!/usr/bin/env bash
# The folder rule holds for this checkout, and it fails on each kind of violation when one is planted
# in a copy.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../.." && pwd)
copy=$(mktemp -d)
trap 'rm -rf "$copy"' EXIT
cp -r "$root"/{core,acquisition,centroiding,reconstruct,detect,service,tests} "$copy"
mkdir "$copy/docs"
cp "$root/docs/architecture.md" "$copy/docs"
bash "$here/folder_rule.sh" "$copy"

bad=0
plant() {  # plant <file> <line of code> <words of the rule that must be named>
  local before=""
  [ -f "$copy/$1" ] && before=$(cat "$copy/$1")
  echo "$2" >>"$copy/$1"
  if told=$(bash "$here/folder_rule.sh" "$copy"); then
    echo "not seen: $2 in $1"
    bad=1
  elif ! grep -qF "folder rule: $3" <<<"$told"; then
    printf 'seen for another reason: %s in %s\n%s\n' "$2" "$1" "$told"
    bad=1
  fi
  if [ -n "$before" ]; then printf '%s\n' "$before" >"$copy/$1"; else rm "$copy/$1"; fi
}

plant core/frame.h '#include "detect/circulation.h"' 'core/ includes core/ and itself only'
plant detect/circulation.h '#include "centroiding/slopes.h"' 'detect/ includes core/'
plant reconstruct/split.cpp '#include "service/config.h"' 'reconstruct/ includes core/'
plant service/stages.cpp '#include "tests/support/program.h"' 'service/ does not include tests/'
plant service/results/vortex_printer.h '#include "service/bench/detection_score.h"' \
  'only training/ and commands/ include bench/'
plant service/daemon/daemon.cpp '#include "service/training/scout_training.h"' \
  'only commands/ includes training/'
plant service/pipeline.cpp '#include "service/commands/commands.h"' \
  'nothing but main.cpp includes commands/'
plant core/image.h '#include <spdlog/spdlog.h>' 'core/ includes std, Eigen and the queue only'
plant service/feed.cpp '#include <concurrentqueue/concurrentqueue.h>' 'the moodycamel queue'
plant acquisition/recording/fits_cube.cpp '#include <fitsio.h>' 'cfitsio in acquisition/fits/'
plant acquisition/fits/fits_file.h '#include <fitsio.h>' 'cfitsio in acquisition/fits/'
plant acquisition/recording/fits_cube.cpp '#include <png.h>' 'libpng in acquisition/pictures/'
plant service/picture/canvas.cpp '#include <tiffio.h>' 'libtiff in acquisition/pictures/'
plant acquisition/usb/usb_camera.cpp '#include <arv.h>' 'Aravis in acquisition/aravis/'
plant service/doctor/machine_links.cpp '#include <libusb-1.0/libusb.h>' 'libusb in acquisition/usb/'
plant detect/circulation.cpp '#include <spdlog/spdlog.h>' 'spdlog in service/'
plant service/results/frame.h '#pragma once' 'no two files have one name'
mkdir "$copy/service/attic"
plant service/attic/old.cpp 'int old;' 'docs/architecture.md lists every room'
exit $bad
