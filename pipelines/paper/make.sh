#!/usr/bin/env bash
# Makes stand-ins of the five surveys of "Virtual LiDAR Simulation as a High Performance Computing Challenge" (2022):
#
#     pipelines/paper/make.sh [SCALE] [FOLDER]
#
# SCALE 1 has the paper's number of primitives; the default is 0.01. Area and primitives shrink together, so that their
# density stays. FOLDER (default: this one) gets NAME.toml and the scene in NAME/. VLSCAN names the program.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
scale=${1:-0.01}
folder=${2:-$here}
vlscan=${VLSCAN:-vlscan}
mkdir -p "$folder"

calculate() { awk -v s="$scale" "BEGIN { $1 }"; }

# name, edge of the square at scale 1 in m, triangles, voxels: makes the scene and leaves its edge in $edge.
scene() {
  edge=$(calculate "e = $2 * sqrt(s); printf \"%.2f\", (e < 20 ? 20 : e)")
  local triangles voxels
  triangles=$(calculate "n = $3 * s; printf \"%d\", (n < 1000 ? 1000 : n)")
  voxels=$(calculate "printf \"%d\", $4 * s")
  local foliage=()
  [ "$voxels" -gt 0 ] && foliage=(--voxels "$voxels")
  "$vlscan" scene make forest -o "$folder/$1" -n "$triangles" --extent "$edge" --seed 4 --force -q "${foliage[@]}"
}

# name, comment, platform, scanner, pulse rate, scan rate: begins NAME.toml.
begin() {
  cat <<TOML
# $2
# Made by pipelines/paper/make.sh at scale $scale.

name = "$1"
scene = "$1/scene.xml#forest"
seed = 1

[platform]
catalogue = "data/platforms.xml#$3"

[scanner]
catalogue = "data/$4"

[settings]
pulse_freq_hz = $5
scan_freq_hz = $6
TOML
}

# legs, height, speed, overlap to either side: a winding course from the west to the east, turns without pulses. The last
# leg is where the flight ends.
winding() {
  awk -v n="$1" -v z="$2" -v v="$3" -v e="$edge" 'BEGIN {
    strips = (n - 1) / 2
    for (i = 0; i < n; i++) {
      strip = int(i / 2)
      at = strip < strips ? strip : strips - 1
      x = strips > 1 ? e * (at / (strips - 1) - 0.5) * 0.8 : 0
      south = (strip % 2 == 0) == (i % 2 == 0)
      y = (south ? -0.5 : 0.5) * e
      if (i == n - 1) y = 0
      printf "\n[[leg]]\nposition_m = [%.2f, %.2f, %g]\nspeed_m_per_s = %g\n", x, y, z, v
      if (i % 2 == 1 || i == n - 1) print "active = false"
    }
  }'
}

airborne() {
  begin "$1" "$2" sr22 "scanners_als.xml#riegl_vq_780i" 1000000 225
  # The swath is a little wider than the scene.
  calculate "printf \"scan_angle_deg = %.2f\\n\", atan2(0.6 * $edge, 300) * 57.29578"
  winding 41 300 60
}

uncrewed() {
  begin "$1" "$2" copter_linearpath "scanners_als.xml#$3" "$4" "$5"
  echo "scan_angle_deg = 45"
  winding "$6" 60 "$7"
}

terrestrial() {
  begin "$1" "$2" tripod "scanners_tls.xml#riegl_vz400" 100000 50
  cat <<TOML
vertical_angle_min_deg = -40
vertical_angle_max_deg = 60
head_rate_deg_per_s = 60
head_start_deg = 0
head_stop_deg = 360
TOML
  awk -v e="$edge" 'BEGIN {
    for (i = 0; i < 9; i++)
      printf "\n[[leg]]\nposition_m = [%.2f, %.2f, 0]\non_ground = true\n", (i % 3 - 1) * e / 3, (int(i / 3) - 1) * e / 3
  }'
}

# The paper gives primitives, legs, volume, rates, platform and scanner (its Tables 1 and 2), but neither the share of the
# voxels nor the courses; those are ours.
scene FIXED_250 166 494319 1483000
airborne FIXED_250 "Forest of triangles and voxels of 0.25 m from an aeroplane: 41 legs, 1 MHz, 225 Hz." > "$folder/FIXED_250.toml"
scene HAMMERLE 200 4630456 0
uncrewed HAMMERLE "Forest from an uncrewed aircraft: 7 legs, 1.2 MHz, 200 Hz." riegl_vux-1uav22 1200000 200 7 6 \
  > "$folder/HAMMERLE.toml"
scene SCALED_COG 160 10290011 0
airborne SCALED_COG "Dense forest from an aeroplane: 41 legs, 1 MHz, 225 Hz." > "$folder/SCALED_COG.toml"
scene DIWANG 80 11738288 0
terrestrial DIWANG "Very dense forest from nine tripods: 100 kHz, 50 Hz." > "$folder/DIWANG.toml"
scene ARBORETUM 250 6855950 6855949
uncrewed ARBORETUM "Forest of triangles and voxels from a linear path: 21 legs, 100 kHz, 50 Hz." riegl_vux-1uav 100000 50 21 4 \
  > "$folder/ARBORETUM.toml"
