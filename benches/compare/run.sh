#!/usr/bin/env bash
# Times and errors of this program and of OpenCV with NumPy on the same frames, side by side.
set -euo pipefail
cd "$(dirname "$0")/../.."

folder=target/compare
venv=$folder/venv
mkdir -p "$folder"
if ! [ -x "$venv/bin/python" ]; then
  python3 -m venv "$venv"
fi
"$venv/bin/pip" install --quiet --disable-pip-version-check -r benches/compare/requirements.txt
cargo bench --quiet --bench compare -- "$PWD/$folder"
"$venv/bin/python" benches/compare/opencv.py "$folder"
