"""A virtual bench in a process of its own: only levels and settings go in, only counts come out.

server            the process, whose devices can fail at random moments
client            starts the process; devices that talk to it over a local socket
slmsuite_devices  modulator and camera as slmsuite's own classes
"""
