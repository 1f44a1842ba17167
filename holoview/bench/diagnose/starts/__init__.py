"""Starting values that the pictures suggest for the parameters of an effect, beside the points of its scan.

Each effect declares the kinds that suit it (`Effect.start_kinds`); `screening.SuggestedStarts` looks for all kinds.

picture              displaced pictures, ghosts, smears, and planes that are off
fringes              plane fringes over the picture or over a modulator
stuck                columns, rows and pixels of a modulator that are stuck
transmission_slopes  derivatives of χ² by the transmission of every pixel of a modulator, by adjoint passes
"""
