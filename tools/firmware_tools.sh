#!/bin/sh
# Install what the firmware and its emulation are built with. Where that cannot be, say what is missing and go on:
# tests that need it are skipped, and say so.
set -eu
packages="gcc make libc6-dev gcc-avr avr-libc binutils-avr libsimavr-dev libelf-dev"

missing=
for package in $packages; do
    dpkg-query -W -f='${Status}' "$package" 2>/dev/null | grep -q 'ok installed' || missing="$missing $package"
done
[ -n "$missing" ] || exit 0

if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null 2>&1; then
    apt-get update -qq && apt-get install -y -qq --no-install-recommends $missing >/dev/null && exit 0
fi
echo "warning: the firmware's tests will be skipped; missing:$missing; remedy: as root, apt-get install --no-install-recommends$missing" >&2
