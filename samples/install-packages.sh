#!/usr/bin/env bash
# Installs what is missing to build and test on Debian 12. Does nothing when everything is there.
set -euo pipefail
packages="g++ cmake ninja-build ccache pkg-config libsqlite3-dev libmodbus-dev nlohmann-json3-dev libeigen3-dev libcli11-dev catch2
  libzstd-dev libsimdjson-dev libtomlplusplus-dev libcpp-httplib-dev libfmt-dev libpng-dev libssl-dev libhowardhinnant-date-dev tzdata"
missing=""
for package in $packages; do
  dpkg-query -W -f='${Status}' "$package" 2>/dev/null | grep -q 'ok installed' || missing="$missing $package"
done
[ -z "$missing" ] && exit 0
sudo=""
if [ "$(id -u)" != 0 ]; then
  command -v sudo >/dev/null || { echo "missing packages:$missing; install them as root: apt-get install$missing" >&2; exit 1; }
  sudo=sudo
fi
echo "installing:$missing" >&2
$sudo apt-get update -qq
$sudo env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $missing >/dev/null
