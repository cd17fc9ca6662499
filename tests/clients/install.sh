#!/usr/bin/env bash
# Installs Blender as a Python package (bpy, about 400 MB) into tests/clients/.venv for python -m pytest -m clients.
# bpy 5.0.1 is the last for Python 3.11; give another python3.11 as the first argument where python3 is newer.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")"
"${1:-python3}" -m venv .venv
.venv/bin/python -m pip install --quiet bpy==5.0.1
