# For the scripts in this folder, which set `here` to the folder of the repository. Builds the program unless
# VLSCAN names one. `use_folder [FOLDER]` sets `folder`: FOLDER, or a folder under $TMPDIR that is removed at
# the end.
if [ -z "${VLSCAN:-}" ]; then
    (cd "$here" && cargo build --release --quiet)
    VLSCAN="${CARGO_TARGET_DIR:-$here/target}/release/vlscan"
fi

use_folder() {
    if [ $# -gt 0 ]; then
        folder=$1
        mkdir -p "$folder"
    else
        folder=$(mktemp -d)
        trap 'rm -rf "$folder"' EXIT
    fi
}
