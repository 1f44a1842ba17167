"""What the panels of a rig show; imported when a rig is opened, since it brings in libraries that take long to load.

controls      state, the switch that turns the lasers off, devices, captures and plans; the diagnosis
camera_view   camera beside prediction, values under the pointer
"""
