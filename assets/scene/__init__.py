"""The still life: a small ray marcher in numpy that makes the demonstration pictures.

sdf.py         distance functions: rounded box, torus, rod, lathe-turned profiles
solids.py      a placed solid: shape, material, bounding sphere, occlusion proxies
room.py        floor, wall, poster and the light around them
still_life.py  the objects on the table
trace.py       camera and the nearest hit of a bundle of rays
shade.py       light, soft shadows, occlusion, reflection, tone
lens.py        the pinhole picture with its depth, and the thin lens' focal stack
chart.py       the synthetic test chart

Lengths here are scene units (the camera is 1 above the floor): x right, y up, z away from the camera.
Colours are linear sRGB.
"""
