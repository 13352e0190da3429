#!/bin/sh
# Our program with the command line that a comparison of several programs calls: --case C --size S --input DIR --reps N --json FILE.
# Build first: cargo build --release
exec "$(dirname "$0")/../target/release/fringetool" bench peers-case "$@"
