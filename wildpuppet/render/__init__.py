"""The differentiable layered renderer R(V, F, texture): layers back to front, premultiplied alpha-over.

``render.py`` is the public face; ``reference.py`` the plain-torch oracle (any device, any dtype), ``cpu.py`` the fast
path over the Numba kernels in ``kernels.py``. Coordinates are pixels with a corner origin: the centre of pixel
(column, row) is (column + 0.5, row + 0.5).
"""
