"""The subcommands of `holoview`, one a file: `configure` adds its arguments, `run` does it; no physics.

common    arguments and messages that several share
presets   list the benches that come with holoview
info      derived numbers of a bench
render    what an observer sees, as PNG
optimise  a hologram for a picture
export    patterns of a hologram as PNG
demo      both of it on the shipped picture, compared with simultaneous colour
"""
