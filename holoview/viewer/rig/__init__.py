"""A rig beside the document of a viewer.

rig_session     patterns and settings, devices, captures, plans, diagnosis
live_view       the newest picture and its prediction; a diagnosis that follows the captures
"""
