#!/bin/sh
# Submits a run in parts to Slurm: an array that computes them, and a job that merges them when all are complete.
#
#     submit.sh survey.xml survey.laz [PARTS [options of vlscan run]]        64 parts unless told otherwise
#
# The parts go to survey.laz.parts/, the messages to logs/. Options for sbatch alone, such as a partition or an account, are
# taken from SBATCH_PARTITION, SBATCH_ACCOUNT and the like.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
survey=$1 out=$2 of=${3:-64}
[ $# -ge 3 ] && shift 3 || shift 2
mkdir -p logs

# Where the parts begin is found once, before they wait for nodes.
vlscan plan-parts "$survey" -o "$out.parts" "$@"
array=$(sbatch --parsable --array="0-$((of - 1))" "$here/part.sbatch" "$survey" "$out.parts" "$@")
merge=$(sbatch --parsable --dependency="afterok:$array" --kill-on-invalid-dep=yes "$here/merge.sbatch" "$out.parts" -o "$out")
echo "parts: job $array, merge: job $merge"
