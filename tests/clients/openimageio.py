"""Runs inside OpenImageIO's Python, not ours.

python openimageio.py st_warp ATLAS.png ST.exr U,V WIDTH HEIGHT OUT.exr   the atlas through a map of two channels
python openimageio.py info FILE.exr                                       channels and attributes, as JSON
"""

import json
import sys

import OpenImageIO


def st_warp(atlas: str, maps: str, channels: str, width: str, height: str, out: str) -> None:
    every = OpenImageIO.ImageBuf(maps)
    u, v = (list(every.spec().channelnames).index(name) for name in channels.split(","))
    texture = OpenImageIO.ImageBuf(atlas)  # a PNG comes premultiplied
    roi = OpenImageIO.ROI(0, int(width), 0, int(height), 0, 1, 0, 4)  # by default it is the texture's
    drawn = OpenImageIO.ImageBufAlgo.st_warp(texture, every, "triangle", 0.0, u, v, False, True, roi=roi)
    if drawn.has_error or not drawn.write(out, "float"):
        sys.exit(drawn.geterror())


def info(path: str) -> None:
    spec = OpenImageIO.ImageBuf(path).spec()
    said = {each.name: str(each.value) for each in spec.extra_attribs}
    sys.stdout.write(json.dumps({"channels": list(spec.channelnames), "format": str(spec.format), "said": said}))


if __name__ == "__main__":
    globals()[sys.argv[1]](*sys.argv[2:])
