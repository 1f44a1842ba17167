"""What a simulation gets wrong about a real bench: from captures to named causes, an extended model, and the gain.

measured noise split        pictures ready to compare; weights; which captures are fitted, which judged
comparison resample         residuals with gains and movements of the camera taken out
bench unknowns levenberg    what a search works with; parameters as vectors; local fits
screen displacement ghosts  a first look at every effect; starting values read off the pictures
search select               the best values of an effect; forward selection of causes
decide uncertainty          the verdict; intervals
confounds power drift       look-alikes and what separates them; what the gains tell; lasers that drift
excess freeform             where an error lives: by property, and by free maps at each place
diagnose diagnosis          all of it in order; the result and its JSON
extend display              a bench with the causes switched on, and what it buys on the display
plots report words          pictures and the HTML report; values in people's units
draw                        random values of an effect, for tests that hide one
"""
