"""The document that a viewer or notebook edits, its background jobs and its files; this package knows no window.

document              system, patterns, target and view settings as immutable data; undo and redo as a list of them
editing_session       the document with undo, jobs, snapshots and messages, owned by one thread; choices of a user
jobs                  background jobs with progress, pause and cancellation
focus_edits           edits of the focal plane, of the eye, and of the pupil's recorded path
target_builder        the image that a hologram should show, built on a worker thread
measurements          measurements of an image; those of the displayed one, kept up to date
optimisation_job      optimises patterns as a job with preview; goes on with it after a crash; jobs that measure speckle
example               the shipped example, which a new session shows
file_loader           opens files: recognises, reads, and reloads them when they are rewritten
recording_edits       kind, order and steps of the recording that a field is of
received_fields       shows fields that other running programs send
rig_session           a rig beside the document: patterns and settings, devices, captures, plans, diagnosis
live_view             the newest picture and its prediction; a diagnosis that follows the captures
exports               writes images, animations, figures and holograms
archive               the format of a saved session
session_store         finds, saves and restores sessions; the user's preferences
"""
