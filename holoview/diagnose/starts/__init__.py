"""Starting values that the pictures suggest for the parameters of an effect, beside the points of its scan.

Each effect declares the kinds that suit it (`Effect.start_kinds`).

by_kind              the starting values of all kinds that captures suggest for an effect
picture              displaced pictures, ghosts, smears, and planes that are off
fringes              plane fringes over the picture or over a modulator
stuck                columns, rows and pixels of a modulator that are stuck
transmission_slopes  derivatives of χ² by the transmission of every pixel of a modulator, by adjoint passes
"""
