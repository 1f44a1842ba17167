"""What a viewer or notebook edits, computes in the background and saves; it knows no window.

editing_session       the document with undo, jobs, snapshots and messages, owned by one thread
document              system, patterns, target and view settings as immutable data
target_spec           what a hologram should show
example               the shipped hologram, which a new session shows
target_builder        builds targets on a worker thread
focal_plane           moves the focal plane
eye_edits             puts an eye in place, moves its pupil
pupil_motion          records the path of the pupil, and moves it along that path
changes               which parts of a session changed; listeners
history               undo and redo
jobs                  background jobs with progress, pause and cancellation
call_queue            calls from any thread to the owner's
messages              a log of messages to the user
optimisation_job      optimises patterns as a job with preview
optimisation_choices  what a user has chosen for the next optimisation
scheme_comparison     compares two colour schemes by speckle contrast
measure               speckle contrast, PSNR and colour error of a region; profiles; pixel values
live_measurement      the same, kept up to date for the displayed image
retinal_curve         speckle contrast on the retina against the diameter of the pupil
live_score            PSNR and a perceptual score of the displayed image, kept up to date
limit_notes           where the model isn't true of the displayed bench
chromaticity_diagram  spectral locus, display primaries, gamut of the lasers
file_reader           recognises a file by its content and reads it
file_loader           applies a file to a session; reloads it when it is rewritten
file_watcher          reports when a file was rewritten
archive               the format of a saved session
autosave              saves a session whenever it changes
session_store         finds and restores saved sessions
preferences           the user's preferences and recent files
export                writes images, animations, figures and holograms
"""
