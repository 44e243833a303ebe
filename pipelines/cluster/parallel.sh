#!/bin/sh
# A run in shards with GNU parallel: on this machine, or on the hosts of a file with one name per line, which share the folder
# and have vlscan on their path. What is complete is kept, so that an interrupted run goes on where it was.
#
#     parallel.sh survey.xml survey.laz [SHARDS [HOSTS]]        16 shards on this machine unless told otherwise
#
# Needs vlscan on the path and GNU parallel (apt install parallel).
set -eu
survey=$1 out=$2 of=${3:-16} hosts=${4:-}
threads=${VLSCAN_THREADS:-4}
vlscan index-shards "$survey" -o "$out.shards"
last=$((of - 1))
run="vlscan run '$survey' --shard {}/$of -o '$out.shards' -j $threads --resume -q"
if [ -n "$hosts" ]; then
  seq 0 "$last" | parallel --will-cite --retries 3 --sshloginfile "$hosts" --workdir "$PWD" --jobs 1 "$run"
else
  cores=$(getconf _NPROCESSORS_ONLN)
  seq 0 "$last" | parallel --will-cite --retries 3 --jobs $(( (cores + threads - 1) / threads )) "$run"
fi
vlscan merge "$out.shards" -o "$out" --force
