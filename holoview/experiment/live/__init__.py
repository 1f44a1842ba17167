"""A rig beside the document of a viewer: live pictures with their prediction, captures, plans; it knows no window.

rig_session      what a front end controls: patterns and settings, devices, captures, plans, diagnosis
live_view        the newest picture and its prediction
live_diagnosis   a diagnosis that follows the captures
"""
