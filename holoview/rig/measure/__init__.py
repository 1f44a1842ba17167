"""Measures captures with a rig by a plan; each capture is on the disk as soon as it is taken.

capture_plan      which captures: patterns, wavelength, distance, power, exposure; how long they take
camera_pictures   pictures that measurements can rely on: exposed, checked, dark
settling          how fast a modulator settles
measurement       takes the missing captures, and can be interrupted anywhere
capture_folder    captures one by one in a folder, in the end one capture file; the record of the bench beside them
"""
