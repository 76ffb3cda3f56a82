#!/bin/sh
# Install the browser that the operator's page is tested in. Where that cannot be, say so and go on: tests that need it
# are skipped, and say so.
set -eu
command -v chromium >/dev/null 2>&1 && exit 0
command -v chromium-browser >/dev/null 2>&1 && exit 0

if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null 2>&1; then
    apt-get update -qq && apt-get install -y -qq --no-install-recommends chromium >/dev/null && exit 0
fi
echo "warning: the page's tests in a browser will be skipped; missing: chromium; remedy: as root, apt-get install --no-install-recommends chromium" >&2
