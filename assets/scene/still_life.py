"""The objects: near ones left, far ones right, saturated colours beside neutral greys, and small things for the eye."""

from __future__ import annotations

import math

import numpy as np

from assets.scene.room import Floor
from assets.scene.sdf import Vec, dimpled, lathe, rod, rounded_box, sphere, torus, union
from assets.scene.shade import Scene
from assets.scene.solids import Colour, Material, Solid
from assets.scene.trace import Camera

_RED: Colour = (0.68, 0.018, 0.02)
_YELLOW: Colour = (0.86, 0.58, 0.02)
_GREEN: Colour = (0.03, 0.42, 0.06)
_BLUE: Colour = (0.015, 0.06, 0.56)
_WHITE: Colour = (0.80, 0.79, 0.77)
_GREY: Colour = (0.21, 0.21, 0.21)
_CYAN: Colour = (0.02, 0.42, 0.50)
_MAGENTA: Colour = (0.50, 0.02, 0.28)
_ORANGE: Colour = (0.85, 0.20, 0.01)


def _arc(height: float, radius: float, start: float, end: float = 90, points: int = 9) -> list[tuple[float, float]]:
    """Profile points on a circle about (0, height), between two elevations in degrees; the first is a corner."""
    angles = np.radians(np.linspace(start, end, points))
    arc = [(radius * math.cos(a), height + radius * math.sin(a)) for a in angles]
    return [arc[0], *arc]


_QUEEN = [(0, 0), (0.185, 0), (0.185, 0), (0.19, 0.03), (0.185, 0.06), (0.15, 0.075), (0.15, 0.075), (0.155, 0.1)]
_QUEEN += [(0.14, 0.125), (0.105, 0.15), (0.075, 0.24), (0.06, 0.36), (0.062, 0.43), (0.062, 0.43), (0.1, 0.44)]
_QUEEN += [(0.105, 0.455), (0.1, 0.47), (0.07, 0.478), (0.07, 0.478), (0.075, 0.52), (0.115, 0.62), (0.115, 0.62)]
_QUEEN += [(0.095, 0.625), (0.095, 0.625), (0.07, 0.65), (0.022, 0.668), *_arc(0.694, 0.034, -50)]
_PEAR = [(0, 0.02), (0.06, 0.0), (0.16, 0.05), (0.205, 0.16), (0.18, 0.27), (0.115, 0.37), (0.09, 0.44), (0.07, 0.5)]
_PEAR += [(0.03, 0.525), (0, 0.515)]
_VASE = [
    (0, 0),
    (0.13, 0),
    (0.13, 0),
    (0.15, 0.02),
    (0.24, 0.2),
    (0.26, 0.36),
    (0.21, 0.52),
    (0.11, 0.64),
    (0.08, 0.74),
]
_VASE += [(0.1, 0.82), (0.14, 0.86), (0.135, 0.87), (0.09, 0.83), (0.065, 0.74), (0.065, 0.74), (0, 0.7)]
_PAWN = [(0, 0), (0.14, 0), (0.14, 0), (0.145, 0.025), (0.135, 0.05), (0.11, 0.065), (0.11, 0.065), (0.1, 0.1)]
_PAWN += [(0.055, 0.17), (0.045, 0.25), (0.045, 0.25), (0.085, 0.265), (0.08, 0.285), (0.05, 0.29)]
_PAWN += _arc(0.36, 0.088, -52)
_CUP = [(0, 0), (0.13, 0), (0.13, 0), (0.14, 0.02), (0.15, 0.36), (0.14, 0.37), (0.13, 0.36), (0.12, 0.1), (0, 0.08)]


def scene() -> Scene:
    """The whole still life."""
    pieces = [
        _queen(0.2, 2.62),
        _pear(0.5, 3.15),
        _vase(0.83, 5.15),
        _pawn(0.64, 3.9, _GREEN),
        _pawn(0.955, 3.7, _WHITE),
    ]
    return Scene(
        [*pieces, _chrome(0.365, 4.3), *_ring(0.735, 2.95), _die(0.46, 2.47), *_pencils(0.085, 5.3), *_beads()], Floor()
    )


def _place(across: float, z: float, y: float = 0.0) -> tuple[float, float, float]:
    """The place at depth z that appears at `across` (0 left … 1 right) in the picture."""
    return (across - 0.5) * Camera().field * z, y, z


def _queen(across: float, z: float) -> Solid:
    crown = [(0.1 * math.cos(a), 0.632, 0.1 * math.sin(a)) for a in np.arange(10) * math.tau / 10]
    shape = union(dimpled(lathe(_QUEEN), crown, 0.026))
    proxies = ((0, 0.08, 0, 0.16), (0, 0.25, 0, 0.09), (0, 0.45, 0, 0.09), (0, 0.6, 0, 0.1))
    return Solid(shape, Material(_RED, 0.06, 160), _place(across, z), (0, 0.355, 0), 0.42, proxies=proxies)


def _pear(across: float, z: float) -> Solid:
    shape = union(lathe(_PEAR), rod((0, 0.5, 0), (0.035, 0.585, 0.01), 0.011))
    proxies = ((0, 0.17, 0, 0.19), (0, 0.4, 0, 0.1))
    return Solid(shape, Material(_pear_skin, 0.045, 40), _place(across, z), (0, 0.29, 0), 0.34, 0.5, proxies)


def _pear_skin(p: Vec) -> Vec:
    """Yellow with a red cheek on one side, small dots, and a brown stem."""
    cheek = np.clip((p[0] * 0.8 - p[2] * 0.6) * 5 - 0.1, 0, 1) * np.clip(1.25 - p[1] * 2.6, 0, 1)
    angle = np.arctan2(p[2], p[0])
    dots = (np.sin(angle * 23 + 9 * np.sin(p[1] * 41)) * np.sin(p[1] * 130 + 5 * np.sin(angle * 7)) > 0.93) * 0.35
    stem = p[1] > np.float32(0.528)
    end: Colour = (0.72, 0.08, 0.02)
    mixed = [(y + (e - y) * cheek) * (1 - dots) for y, e in zip(_YELLOW, end, strict=True)]
    r, g, b = (
        np.where(stem, np.float32(s), m).astype(np.float32) for s, m in zip((0.1, 0.05, 0.02), mixed, strict=True)
    )
    return r, g, b


def _vase(across: float, z: float) -> Solid:
    proxies = ((0, 0.3, 0, 0.25), (0, 0.7, 0, 0.12))
    return Solid(lathe(_VASE), Material(_glaze, 0.06, 200), _place(across, z), (0, 0.435, 0), 0.49, proxies=proxies)


def _glaze(p: Vec) -> Vec:
    """Blue with two white bands and a zigzag between them."""
    zigzag = np.abs(np.abs((np.arctan2(p[2], p[0]) * (12 / math.tau)) % 1 - 0.5) * 0.16 + 0.29 - p[1]) < 0.011
    bands = (np.abs(p[1] - np.float32(0.25)) < 0.012) | (np.abs(p[1] - np.float32(0.41)) < 0.012) | zigzag
    r, g, b = (np.where(bands, np.float32(w), np.float32(c)) for w, c in zip(_WHITE, _BLUE, strict=True))
    return r, g, b


def _pawn(across: float, z: float, colour: Colour) -> Solid:
    proxies = ((0, 0.06, 0, 0.12), (0, 0.2, 0, 0.06), (0, 0.36, 0, 0.085))
    return Solid(lathe(_PAWN), Material(colour, 0.05, 120), _place(across, z), (0, 0.22, 0), 0.27, proxies=proxies)


def _chrome(across: float, z: float) -> Solid:
    return Solid(sphere(0.27), Material((0.1, 0.1, 0.1), 0.72, 400), _place(across, z, 0.27), (0, 0, 0), 0.27)


def _ring(across: float, z: float) -> list[Solid]:
    """A striped ring on the floor, and a matte grey ball inside it."""
    ring = Material(_stripes, 0.04, 60)
    proxies = tuple((0.19 * math.cos(a), 0.0, 0.19 * math.sin(a), 0.06) for a in np.arange(8) * math.tau / 8)
    place = _place(across, z, 0.055)
    ball = Solid(sphere(0.105), Material((0.34, 0.34, 0.34), 0.0), (place[0], 0.105, z), (0, 0, 0), 0.106)
    return [Solid(torus(0.19, 0.055), ring, place, (0, 0, 0), 0.25, proxies=proxies), ball]


def _stripes(p: Vec) -> Vec:
    phase = np.floor(np.arctan2(p[2], p[0]) * (24 / math.tau)) % 2
    r, g, b = (np.where(phase > 0, np.float32(c), np.float32(w)) for c, w in zip(_ORANGE, _WHITE, strict=True))
    return r, g, b


def _die(across: float, z: float) -> Solid:
    side, off = 0.085, 0.042
    pips = [(i * off, side, j * off) for i, j in ((-1, -1), (-1, 1), (0, 0), (1, -1), (1, 1))]
    pips += [(i * off, j * off, -side) for i, j in ((-1, -1), (-1, 0), (-1, 1), (1, -1), (1, 0), (1, 1))]
    pips += [(-side, i * off, j * off) for i, j in ((-1, 1), (0, 0), (1, -1))]
    pips += [(side, i * off, j * off) for i, j in ((-1, -1), (1, 1))]

    def paint(p: Vec) -> Vec:
        dark = np.zeros(p[0].shape, dtype=bool)
        for x, y, w in pips:
            dark |= (p[0] - np.float32(x)) ** 2 + (p[1] - np.float32(y)) ** 2 + (p[2] - np.float32(w)) ** 2 < 0.0195**2
        r, g, b = (np.where(dark, np.float32(d), np.float32(c)) for d, c in zip((0.8, 0.8, 0.8), _CYAN, strict=True))
        return r, g, b

    shape = dimpled(rounded_box((side, side, side), 0.018), pips, 0.018)
    return Solid(shape, Material(paint, 0.05, 100), _place(across, z, side), (0, 0, 0), 0.14, 0.6)


def _pencils(across: float, z: float) -> list[Solid]:
    """A grey cup with five pencils."""
    place = _place(across, z)
    cup = Solid(lathe(_CUP), Material(_GREY, 0.02, 30), place, (0, 0.185, 0), 0.25, proxies=((0, 0.15, 0, 0.14),))
    sticks = []
    inks = (_RED, _YELLOW, _GREEN, _BLUE, _MAGENTA)
    for number, ink in enumerate(inks):
        angle = number * math.tau / len(inks) + 0.4
        foot, tip = (
            (-0.06 * math.cos(angle), 0.1, -0.06 * math.sin(angle)),
            (0.15 * math.cos(angle), 0.62, 0.12 * math.sin(angle)),
        )
        sticks.append(_pencil(place, foot, tip, ink))
    return [cup, *sticks]


def _pencil(
    place: tuple[float, float, float], foot: tuple[float, float, float], tip: tuple[float, float, float], ink: Colour
) -> Solid:
    def paint(p: Vec) -> Vec:
        wood = p[1] > np.float32(tip[1] - 0.05)
        r, g, b = (np.where(wood, np.float32(w), np.float32(c)) for w, c in zip((0.62, 0.42, 0.24), ink, strict=True))
        return r, g, b

    centre = tuple((f + t) / 2 for f, t in zip(foot, tip, strict=True))
    half = math.dist(foot, tip) / 2 + 0.02
    return Solid(
        rod(foot, tip, 0.016),
        Material(paint, 0.03, 40),
        place,
        (centre[0], centre[1], centre[2]),
        half,
        proxies=((*foot, 0.01),),
    )


def _beads() -> list[Solid]:
    """Small glass beads strewn through the depths."""
    strewn = (
        (0.335, 2.5, 0.045, _YELLOW),
        (0.375, 2.68, 0.03, _BLUE),
        (0.08, 2.33, 0.035, _GREEN),
        (0.6, 2.42, 0.04, _RED),
        (0.645, 2.52, 0.028, _WHITE),
        (0.575, 2.75, 0.032, _MAGENTA),
        (0.9, 2.55, 0.05, _BLUE),
        (0.865, 2.42, 0.03, _YELLOW),
        (0.4, 3.35, 0.04, _ORANGE),
        (0.31, 3.4, 0.05, _CYAN),
        (0.85, 3.75, 0.05, _RED),
        (0.72, 4.5, 0.06, _YELLOW),
        (0.545, 4.9, 0.07, _RED),
        (0.48, 5.2, 0.06, _GREEN),
        (0.645, 5.4, 0.08, _WHITE),
        (0.935, 5.0, 0.07, _MAGENTA),
        (0.24, 5.0, 0.07, _BLUE),
    )
    return [
        Solid(sphere(r), Material(ink, 0.06, 200), _place(across, z, r), (0, 0, 0), r, proxies=((0, 0, 0, r),))
        for across, z, r, ink in strewn
    ]
