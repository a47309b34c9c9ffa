#!/usr/bin/env bash
# package_test.sh <build directory>: the Debian package installs, runs, keeps what belongs to the
# user, and leaves nothing behind. It runs in an overlay over this machine's root, so that the
# machine stays as it is.
set -euo pipefail
build=$(realpath "$1")

skip() { echo "skipped: $*"; exit 77; }
fail() { echo "FAILED: $*" >&2; exit 1; }

if [ "${2:-}" != inside ]; then
  [ "$(id -u)" -eq 0 ] || skip "not root"
  for tool in cpack dpkg dpkg-shlibdeps systemd-analyze systemd-sysusers unshare setpriv; do
    command -v "$tool" >/dev/null || skip "no $tool"
  done
  [ -x "$build/curlew" ] || fail "$build/curlew is not built"
  dpkg-query -W curlew >/dev/null 2>&1 && skip "curlew is installed on this machine"
  scratch=$(mktemp -d)
  trap 'rm -rf "$scratch"' EXIT
  mkdir "$scratch/deb"
  cpack --config "$build/CPackConfig.cmake" -B "$scratch/deb" >"$scratch/cpack.log" 2>&1 ||
    { cat "$scratch/cpack.log"; fail "cpack"; }
  # This has a mount namespace of its own, with which its mounts go away.
  code=0
  unshare --mount bash -s -- "$scratch" "$build" "$(realpath "$0")" <<'INSIDE' || code=$?
set -eu
scratch=$1
mkdir "$scratch/changes" "$scratch/root"
mount -t tmpfs none "$scratch/changes" || exit 77
mkdir "$scratch/changes/upper" "$scratch/changes/work"
mount -t overlay none "$scratch/root" \
  -o "lowerdir=/,upperdir=$scratch/changes/upper,workdir=$scratch/changes/work" || exit 77
mkdir -p "$scratch/root/package"
cp "$scratch"/deb/*.deb "$3" "$scratch/root/package/"
for folder in proc sys dev; do mount --rbind "/$folder" "$scratch/root/$folder"; done
mount -t tmpfs none "$scratch/root/tmp"
mount -t tmpfs none "$scratch/root/run"
chroot "$scratch/root" bash /package/package_test.sh /package inside
INSIDE
  [ "$code" -ne 77 ] || skip "no overlay file system"
  exit "$code"
fi

# From here on it runs inside, where / is a copy that nobody keeps.
cd /package
export LC_ALL=C
deb=$(echo curlew_*.deb)
unit=/usr/lib/systemd/system/curlew.service
quietly() { "$@" >/tmp/log 2>&1 || { cat /tmp/log; fail "$*"; }; }
purge() { quietly dpkg --purge curlew; }
# Prints all files whose names hold curlew, and its accounts.
traces() {
  find /etc /usr /var /opt -xdev -name '*curlew*' ! -path '/var/log/*' ! -path "/var/cache/*" \
    2>/dev/null | sort
  getent passwd curlew || true
  getent group | grep curlew || true
}
before=$(traces)

echo "== $deb, $(stat -c %s "$deb") bytes, unpacked $(dpkg-deb -f "$deb" Installed-Size) kB"
dpkg-deb -f "$deb" Depends
[[ $(dpkg-deb -f "$deb" Depends) != *-dev* ]] || fail "it needs headers"
for library in libaravis libusb libcfitsio libpng libtiff libsystemd; do
  [[ $(dpkg-deb -f "$deb" Depends) == *$library* ]] || fail "it does not say it needs $library"
done
dpkg-deb -c "$deb" | awk '$1 !~ /^d/ {print $2, $6}' | sort -k2 >/tmp/content
cat /tmp/content
if grep -v '^root/root ' /tmp/content; then fail "files of somebody's own"; fi
if grep -E '\.(h|a|so|cmake|pc)$' /tmp/content; then fail "a file for developers"; fi

# The package is looked at as packed, because a machine may install neither documents nor man pages.
dpkg-deb -x "$deb" /tmp/packed
man=/tmp/packed/usr/share/man
doc=/tmp/packed/usr/share/doc/curlew

echo "== documents"
for file in README.md docs/live.md docs/detection.md docs/adr docs/paper/figure5.png \
  docs/plot_frame.py; do
  [ -e "$doc/$file" ] || fail "$file is not in the package"
done
find "$doc" -name '*.md' | while read -r file; do
  { grep -oE '\]\([^)#]+' "$file" || true; } | cut -c3- | while read -r link; do
    [[ $link == *://* ]] && continue
    [ -e "$(dirname "$file")/$link" ] || fail "$file links to $link, which is not in the package"
  done
done

echo "== install"
quietly dpkg -i "$deb"
for file in /usr/bin/curlew $unit /etc/curlew/curlew.toml /usr/lib/sysusers.d/curlew.conf \
  /usr/lib/sysctl.d/90-curlew.conf /usr/lib/udev/rules.d/70-curlew-cameras.rules \
  /usr/lib/udev/rules.d/71-curlew-realtime.rules; do
  [ -f "$file" ] || fail "$file is missing"
  [ "$(stat -c %U "$file")" = root ] || fail "$file is not root's"
done
getent passwd curlew >/dev/null || fail "no user curlew"
id -nG curlew | grep -qw plugdev || fail "curlew may not open cameras"
if find /etc/systemd -name '*curlew*' | grep .; then fail "the service is enabled"; fi
quietly dpkg --audit

echo "== run"
quietly curlew --version
quietly curlew doctor --config /etc/curlew/curlew.toml --seconds 0.1
grep -q 'ready for real time' /tmp/log || fail "doctor has no opinion"
quietly setpriv --reuid curlew --regid curlew --init-groups \
  curlew doctor --config /etc/curlew/curlew.toml --seconds 0.1

echo "== man pages"
for page in man1/curlew.1 man5/curlew.toml.5; do
  gzip -dc "$man/$page.gz" >"/tmp/${page#*/}" || fail "$page is not in the package"
done
if grep -n '@[A-Z]*@' /tmp/curlew.1 /tmp/curlew.toml.5; then fail "a page is not filled in"; fi
for page in curlew.1 curlew.toml.5; do
  if command -v groff >/dev/null; then
    groff -man -ww -K utf8 -T utf8 -P -cbou "/tmp/$page" >"/tmp/$page.text" 2>/tmp/log
    if [ -s /tmp/log ]; then cat /tmp/log; fail "$page is not clean troff"; fi
  else
    echo "not rendered, for want of groff: $page"
    sed -E 's/\\f[A-Z]|\\&//g; s/\\-/-/g; s/^\.[A-Z]+ *//' "/tmp/$page" >"/tmp/$page.text"
  fi
done
told() { grep -qE -- "^ *$2( |$)" "/tmp/$1.text" || fail "$1 does not tell of $2"; }
subcommands() { curlew "$@" --help | sed -n '/^Subcommands:/,$ s/^  \([a-z-]*\) .*/\1/p'; }
tell_of_command() {
  told curlew.1 "curlew $*"
  for option in $(curlew "$@" --help | sed -n 's/^  \(--[a-z0-9-]*\).*/\1/p'); do
    told curlew.1 "$option"
  done
}
[ "$(subcommands | wc -l)" -ge 9 ] || fail "commands are not seen"
for command in $(subcommands); do
  tell_of_command "$command"
  for below in $(subcommands "$command"); do tell_of_command "$command" "$below"; done
done
# doctor_test.cpp checks that curlew.toml has every setting.
settings=$(sed -nE 's/^(# )?([a-z_]+) = .*/\2/p' /etc/curlew/curlew.toml)
[ "$(wc -l <<<"$settings")" -ge 80 ] || fail "settings are not seen"
for setting in $settings; do told curlew.toml.5 "$setting ="; done
for section in $(grep -oE '^\[[a-z]+' /etc/curlew/curlew.toml); do
  told curlew.toml.5 "\\$section\]"
done
for file in $(grep -ohE '/usr/(lib|share)/[A-Za-z0-9/.-]+' /tmp/*.text); do
  [ -e "/tmp/packed${file%.}" ] || fail "a page names $file, which is not packed"
done
# The examples in the pages must do what they say.
example() { sed -n '/^\.EX/,/^\.EE/p;/^\.EE/q' "/tmp/$1" | grep -v '^\.E' | sed 's/\\-/-/g'; }
mkdir /tmp/example
cd /tmp/example
example curlew.1 >demo.sh
grep -q '^curlew replay' demo.sh || fail "the example does not replay"
quietly bash -e demo.sh
[ -s results.fits ] || fail "the example has no results"
example curlew.toml.5 >example.toml
quietly curlew doctor --config example.toml --seconds 0
cd /package

echo "== unit"
for page in $(grep -oE 'man:[a-z.]+\([0-9]\)' $unit); do
  page=${page#man:}
  number=${page: -2:1}
  [ -e "$man/man$number/${page%(*}.$number.gz" ] || fail "the unit names $page, which is not packed"
done
for file in $(grep -oE 'file:[^ ]+' $unit); do
  [ -e "/tmp/packed${file#file:}" ] || fail "the unit names $file, which is not packed"
done
quietly systemd-analyze verify --man=no $unit
if [ -s /tmp/log ]; then cat /tmp/log; fail "systemd-analyze verify has remarks"; fi
# What remains is what cameras and real time need, see the unit.
bound=2.0
systemd-analyze security --offline=true --no-pager $unit | grep 'exposure level'
systemd-analyze security --offline=true --threshold=20 --no-pager $unit >/dev/null ||
  fail "the unit's exposure is above $bound"

echo "== what is the user's stays"
echo '# mine' >>/etc/curlew/curlew.toml
quietly dpkg -i "$deb"
grep -q '# mine' /etc/curlew/curlew.toml || fail "an edited configuration was replaced"
quietly dpkg --remove curlew
[ ! -e /usr/bin/curlew ] || fail "removed, and still there"
grep -q '# mine' /etc/curlew/curlew.toml || fail "a removed package took its configuration along"
install -d -o curlew /var/lib/curlew
echo frames >/var/lib/curlew/recording.fits
purge
[ "$(cat /var/lib/curlew/recording.fits)" = frames ] || fail "recordings were deleted"
[ "$(stat -c %U /var/lib/curlew)" = curlew ] || fail "recordings lost their owner"

echo "== nothing else stays"
quietly dpkg -i "$deb"
rm /var/lib/curlew/recording.fits
purge
[ "$(traces)" = "$before" ] || { traces; fail "left behind"; }
quietly dpkg --audit

echo "== python3-curlew"
python_deb=$(echo python3-curlew_*.deb)
dpkg-deb -c "$python_deb" | awk '$1 !~ /^d/ {print $2, $6}'
if dpkg-deb -c "$python_deb" | grep pycache; then fail "byte code is packed"; fi
for file in $(dpkg-deb -c "$python_deb" | awk '$1 !~ /^d/ {print $6}'); do
  [[ $file == ./usr/lib/python3/dist-packages/curlew/* ]] || fail "$file is out of place"
done
if dpkg-query -W python3-astropy >/dev/null 2>&1; then
  quietly dpkg -i "$python_deb"
  quietly /usr/bin/python3 -c 'import curlew; curlew.Stream, curlew.read_results, curlew.Pipeline'
  quietly dpkg --purge python3-curlew
  [ "$(traces)" = "$before" ] || { traces; fail "left behind by python3-curlew"; }
fi
echo "== passed"
