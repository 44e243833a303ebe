#!/bin/sh
# A forest of a billion triangles: makes it, scans it, and says how long that took and how much memory.
#
#   benches/billion.sh [FOLDER]        default: a folder under $TMPDIR, removed at the end
#
# 50 tree models of about 20 000 triangles stand in 1000 places each. Environment: VLSCAN (the program; default: built with
# `cargo build --release`), TRIANGLES (1G), MODELS (50), COPIES (1000), PULSES (2M). Needs Linux or another system with
# GNU time for the peak memory; without it the time alone is told.
set -eu

here=$(cd "$(dirname "$0")/.." && pwd)
. "$here/benches/program.sh"
use_folder "$@"

. "$here/benches/measured.sh"

if [ ! -e "$folder/survey.xml" ]; then
    "$VLSCAN" scene make forest -o "$folder" -n "${TRIANGLES:-1G}" --models "${MODELS:-50}" --copies "${COPIES:-1000}" \
        --pulses "${PULSES:-2M}"
fi
echo "scanning:"
measured "$VLSCAN" run "$folder/survey.xml" -v -o "$folder/points.las" --force
