#!/bin/sh
# Submits a run in shards to Slurm: an array that computes them, and a job that merges them when all are complete.
#
#     submit.sh survey.xml survey.laz [SHARDS [options of vlscan run]]        64 shards unless told otherwise
#
# The shards go to survey.laz.shards/, the messages to logs/. Options for sbatch alone, such as a partition or an account, are
# taken from SBATCH_PARTITION, SBATCH_ACCOUNT and the like.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
survey=$1 out=$2 of=${3:-64}
[ $# -ge 3 ] && shift 3 || shift 2
mkdir -p logs

# Where the shards begin is found once, before they wait for nodes.
vlscan index-shards "$survey" -o "$out.shards" "$@"
array=$(sbatch --parsable --array="0-$((of - 1))" "$here/shard.sbatch" "$survey" "$out.shards" "$@")
merge=$(sbatch --parsable --dependency="afterok:$array" --kill-on-invalid-dep=yes "$here/merge.sbatch" "$out.shards" -o "$out")
echo "shards: job $array, merge: job $merge"
