"""The viewer: panels over an editing session, drawn by Dear ImGui on the device that renders the holograms.

startup             a thread that opens the device and computes the first picture
launch              opens device and session as the command line asks
run                 runs the viewer on a screen, off screen by a script, or in a browser; ends it soon after Ctrl-C
app                 the frame loop, which owns window, panels and context; layout, notifications, menus, status bar
context             shared by panels, overlays and menus; commands with their keys, sheet of keys, palette
window              Dear ImGui on rendercanvas and wgpu
viewport            draws images of the device into a texture: zoom, exposure, comparison; tiles of planes
user_input          events as steps of input, key by key, and how Dear ImGui gets them frame by frame
theme               fonts and colours
tour                the tour of the example
file_dialog         dialogs that choose a file, and offer sessions that a crash left
desktop             file drops, and text and pictures of the clipboard
panel               the base class of panels; drawing that may fail
panels              the panels
widgets             widgets that panels share: buttons of commands, combo boxes, coloured text, tooltips
parameter_widgets   sliders and fields made from a parameter's metadata
plots               small plots
readout             texts of the image panel: values under the pointer, scores, labels
rig_controls        the contents of the panels of a rig
script              drives a viewer off screen: text scripts, synthetic events, frame rate
serve               the server: connections, deadlines, how many clients; who is served, and which requests pass
served_canvas       the canvas that several pages show
notebook            the viewer in a notebook's cell
no_adapter          the page shown without a usable adapter
"""
