"""How long a test waits for an event: it goes on at once when the event comes, however busy the machine is."""

PATIENCE_S = 600.0
"""Seconds after which an event is taken never to come. An idle machine needs a hundredth of them; beside nine other
programs on its cores, a program that a test starts takes a minute to import its libraries."""
