"""The viewer: panels over an editing session, drawn by Dear ImGui on the device that renders the holograms.

end_in_time           ends it soon after Ctrl-C, whatever a driver does
startup               a thread that opens the device and computes the first picture
launch                opens device and session as the command line asks
run                   runs the viewer on a screen, off screen by a script, or in a browser
app                   the frame loop, which owns window, panels and context
context               what panels, overlays and menus share
window                Dear ImGui on rendercanvas and wgpu
input_steps           what events mean: steps of input, one change at a time
imgui_input           gives Dear ImGui the steps frame by frame
window_layout         the initial arrangement of windows, settings of HelloImGui
menus                 the menu bar
status                the status bar
theme                 fonts and colours
toasts                notifications
help_overlay          the sheet of keys and the command palette
file_dialog           the file dialog
recovery_dialog       offers sessions that a crash left
panel                 the base class of panels
draw_guard            drawing that may fail without closing the window
panels                the panels, one module each
command_registry      the commands of the viewer with their keys
general_commands      commands that belong to no panel
keys                  names of keys, chords
parameter_widgets     sliders and fields made from a parameter's metadata
plots                 small plots
laser_colours         display colours of wavelengths
viewport              draws images of the device into a texture: zoom, exposure, comparison
rig                   what the panels of a rig show
image_labels          texts in the image panel
tiles                 clickable pictures of planes
plane_strip           a strip of all planes
plane_sheet           a sheet of all planes
readout               values of the sample under the pointer, scores of the image
score_choice          which score stands beside the PSNR
clipboard             copies and pastes pictures
desktop               file drops and text clipboard of a window
frame_rate            how many images a second the viewer shows, measured off screen
input_driver          synthetic events for a viewer off screen
script                text scripts that use them
serve                 HTTP and WebSocket, protected by a token
serve_options         where and to whom it is served: names, clients, TLS
serve_guard           which requests pass: by name, token and origin
client_places         how many pages are connected at a time, and for how long unused
serve_connections     the server, with deadlines for slow and silent connections
served_canvas         the canvas that several pages show
notebook              the viewer in a notebook's cell
no_adapter            the page shown without a usable adapter
"""
