"""A rig beside the document of a viewer: live pictures with their prediction, captures, plans; it knows no window.

rig_session      what a front end controls: devices, captures, plans, diagnosis
bench_state      patterns for the modulators, and the settings of the devices
live_view        the newest picture and its prediction
live_diagnosis   a diagnosis that follows the captures
"""
