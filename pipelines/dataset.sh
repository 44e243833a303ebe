#!/bin/sh
# A dataset of labelled forests: each scene of its own seed, scanned as dataset.toml says, as many at a time as there are
# cores. Labels are class and hitObjectId (the tree); forestN.csv tells what they mean: species, position, height and number
# of points of every tree. The same seeds give the same bytes. What is there already is kept, so that an interrupted run goes
# on where it was.
#
#     pipelines/dataset.sh [FOLDER [SCENES]]        100 scenes into dataset/ unless told otherwise
#
# Needs vlscan on the path and GNU parallel (apt install parallel).
set -eu
here=$(cd "$(dirname "$0")" && pwd)

one_scene() {
  seed=$1 folder=$2
  work=$folder/scene$seed
  vlscan scene make forest -n 20k --extent 40 --separate-trees --seed "$seed" -o "$work" --force -q
  sed -e 's|^scene = .*|scene = "scene.xml#forest"|' -e "s|^seed = .*|seed = $seed|" "$here/dataset.toml" > "$work/pipeline.toml"
  vlscan run "$work/pipeline.toml" -o "$folder/forest$seed.laz" --parts "$folder/forest$seed.csv" -j 1 -q --force
  rm -r "$work"
}

if [ "${1:-}" = --one ]; then
  one_scene "$2" "$3"
  exit
fi
folder=${1:-dataset} scenes=${2:-100}
mkdir -p "$folder"
seq "$scenes" | while read -r seed; do
  { [ -e "$folder/forest$seed.laz" ] && [ -e "$folder/forest$seed.csv" ]; } || echo "$seed"
done | parallel --will-cite --halt soon,fail=1 "$here/dataset.sh" --one {} "$folder"
ls "$folder"/forest*.laz | wc -l
