#!/usr/bin/env bash
# The figures of `run.sh blocks` for a real answer: `tests/bench/real_body.sh ANSWER.json [ROWS]`. The answer is said ROWS
# times (default 7200, two hours at 1 Hz) by a robot that moves: what profile S in schema/README.md lists changes, each
# number with noise of its own, so no two of them can be told from each other. Lasers are left out, as when polled with
# return_laser false.
set -euo pipefail
if [ $# -lt 1 ] || [ $# -gt 2 ] || [ ! -r "$1" ]; then
  echo "usage: tests/bench/real_body.sh ANSWER.json [ROWS]" >&2
  exit 2
fi
body=$(realpath "$1")
rows=${2:-7200}
cd "$(dirname "$0")/../.."
cmake --preset release >/dev/null
cmake --build --preset release --target block_bench >/dev/null
answers=$(mktemp)
trap 'rm -f "$answers"' EXIT
python3 - "$body" "$rows" >"$answers" <<'PYTHON'
import json, random, re, struct, sys
from datetime import datetime, timedelta

body = json.load(open(sys.argv[1]))
body.pop("lasers", None)
random.seed(1)
NOISE = {"acc_x": 0.01, "acc_y": 0.01, "acc_z": 0.02, "rot_x": 0.05, "rot_y": 0.05, "rot_z": 0.05,
         "roll": 2e-4, "pitch": 2e-4, "yaw": 1e-3, "qw": 3e-4, "qx": 3e-4, "qy": 3e-4, "qz": 3e-4}
DECIMALS = {"x": (4, 0.004), "y": (4, 0.004), "angle": (4, 0.002), "vx": (4, 1e-4), "vy": (4, 1e-4), "w": (4, 1e-4),
            "confidence": (4, 0.025), "voltage": (2, 0.01), "current": (2, 0.05), "controller_temp": (3, 0.05),
            "controller_humi": (3, 0.02), "controller_voltage": (3, 0.02), "r_steer": (4, 1e-3), "steer": (4, 1e-3)}
MILLISECONDS = ("time", "total_time", "today_time")
changed = set()


def single(value):
    """The shortest decimal of the nearest float, as a number."""
    value = struct.unpack("f", struct.pack("f", value))[0]
    for digits in range(6, 10):
        text = f"{value:.{digits}g}"
        if struct.pack("f", float(text)) == struct.pack("f", value):
            return float(text)
    return value


def noisy(path, value, sigma):
    changed.add(path)
    return value + random.gauss(0, sigma)


def stamp(path, text, row):
    changed.add(path)
    return str(int(text) + row * 1_000_000_000 + random.randrange(50_000_000))


def motor(m, name, row):
    m = dict(m)
    for key in ("position", "raw_position", "speed"):
        if m[key] != 0:
            m[key] = single(noisy(f"{name}.{key}", m[key] + 0.01 * row * (key == "position"), 1e-3))
    m["encoder"] += 100 * row + round(random.gauss(0, 10))
    m["header"] = dict(m["header"], data_nsec=stamp(f"{name}.data_nsec", m["header"]["data_nsec"], row))
    return m


def answer(row):
    a = dict(body)
    for key, sigma in NOISE.items():
        a[key] = noisy(key, a[key], sigma)
    for key, (decimals, sigma) in DECIMALS.items():
        a[key] = round(a[key] + random.gauss(0, sigma), decimals)
    for key in MILLISECONDS:
        a[key] += 1000 * row + random.randrange(10)
    a["odo"] = round(a["odo"] + 0.5 * row, 3)
    a["today_odo"] = round(a["today_odo"] + 0.5 * row, 3)
    match = re.fullmatch(r"(.*)([+-]\d{4})", a["create_on"])
    on = datetime.fromisoformat(match[1]) + timedelta(seconds=row, milliseconds=random.randrange(10))
    a["create_on"] = on.isoformat(timespec="milliseconds") + match[2]
    a["imu_header"] = dict(a["imu_header"], data_nsec=stamp("imu", a["imu_header"]["data_nsec"], row))
    a["motor_info"] = [motor(m, m["motor_name"], row) for m in a["motor_info"]]
    a["motor_steer_angles"] = [dict(m, value=noisy("steer", m["value"], 1e-3)) for m in a["motor_steer_angles"]]
    for key, points in (("nearest_obstacles", a["nearest_obstacles"]), ("robot_region", a["robot_region"]["point"])):
        moved = [{c: noisy(f"{key}.{i}.{c}", p[c], 0.004) for c in ("x", "y")} for i, p in enumerate(points)]
        a[key] = moved if key == "nearest_obstacles" else dict(a[key], point=moved)
    return a


for row in range(int(sys.argv[2])):
    print(json.dumps(answer(row), separators=(",", ":"), ensure_ascii=False))
reals = [path for path in changed if "nsec" not in path and path != "imu"]
print(f"real_body: {len(reals)} full-precision numbers change", file=sys.stderr)
PYTHON
build/release/tests/bench/block_bench "$answers"
