"""Experiments on a rig, real or virtual: they predict, diagnose or optimise between captures.

next_capture     takes the captures that tell most about a cause, until it is certain
camera_loop      holograms optimised at what the camera sees
live             a rig beside a document: live pictures with their prediction, captures, a diagnosis that follows
rig_bench        the nominal bench of a rig as a system
known_alignment  what a diagnosis is told of an aligned rig; causes within the alignment's uncertainty
"""
