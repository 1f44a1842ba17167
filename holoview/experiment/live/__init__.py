"""A rig in a session: live pictures beside their prediction, captures, plans, a diagnosis; it knows no window.

rig_session       what a front end controls: devices, captures, plans, diagnosis
rig_devices       the devices; all returns at once, whatever they do
rig_connection    open devices, the thread that uses them, and their closing in a bounded time
device_worker     that thread
watched_devices   which device is being waited for
laser_interlock   lasers that go off at any moment, and stay off
bench_state       what the devices are set to
sent_pattern      patterns for the modulators
live_view         the newest picture and its prediction
live_comparison   a picture beside its prediction, in units of the noise
taken_captures    the captures that were taken
plan_run          runs a plan as a job
live_diagnosis    a diagnosis that follows the captures
rig_bench         the rig's nominal bench as a system
"""
