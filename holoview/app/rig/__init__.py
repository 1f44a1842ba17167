"""What the panels of a rig show; imported when a rig is opened, since it brings in libraries that take long to load.

controls        state, the switch that turns the lasers off
sections        lasers, patterns, camera and stage, captures and plans
camera_view     camera beside prediction, values under the pointer
camera_picture  these pictures on the device
diagnosis_view  the diagnosis that follows the captures
"""
