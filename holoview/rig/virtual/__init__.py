"""A virtual bench in a process of its own: only levels and settings go in, only counts come out.

virtual_settings  what is really there: effects, noise, settling; from the table [virtual] and the file that it names
virtual_bench     the light: patterns, lasers, stage and camera to counts, in simulated time
drift             slow random walks of the camera's place and the lasers' power
faults            devices that fail at random moments
wire              messages over a local socket: a line of JSON and an array
server            the process
slmsuite_devices  modulator and camera as slmsuite's own classes
client            starts the process; devices that talk to it
"""
