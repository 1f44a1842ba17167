"""What a simulation gets wrong about a real bench: from captures to named causes, an extended model, and the gain.

measured noise split        pictures ready to compare; weights; which captures are fitted, which judged
comparison resample         residuals with gains and movements of the camera taken out
bench beams unknowns        what a search works with; what a prediction costs; parameters as vectors
levenberg simplex           local fits: with slopes, and of hard edges
screen displacement ghosts  a first look at every effect; starting values read off the pictures
search refine               the best values of an effect; joint fits of causes
judge select                candidates on held-out captures; forward selection of causes
decide uncertainty          the verdict; intervals
nuisances drift direction   what moves from capture to capture and is nobody's fault
sampling ways               whether the model's samples are what the captures disagree with
confounds power             look-alikes and what separates them; what the gains tell
excess freeform             where an error lives: by property, and by free maps at each place
diagnose diagnosis          all of it in order; the result and its JSON
extend display              a bench with the causes switched on, and what it buys on the display
plots report words          pictures and the HTML report; values in people's units
draw                        random values of an effect, for tests that hide one
"""
