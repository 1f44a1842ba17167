"""General tools that know nothing of optics.

errors            `UserError`, the exception for a user's mistake, and suggestions of similar words
units             text with units such as "8 um" to SI numbers and back, without losing a digit
number_text       columns of numbers as text: what separates them, and which sign is the decimal sign
text              text from files: a line that is safe to show, a plain name of a file
tables            tables of TOML and JSON from unknown sources: their keys, and the types of their values; the same of
                  arrays of files
files             folders of shaders, presets, assets and caches; regular files as input
file_writer       files written whole or not at all, under locks; `WriteError` for a disk that fails; another place for
                  a result
safetensors_file  named tensors with metadata in safetensors files; comparison of a checkpoint with its run
memory_limit      how much memory may be taken, and the refusal of more
processes         signals that ask the program to end, its end beside working threads, when a process began; how many
                  processors there are
mailbox           a thread beside its owner: calls in their order or the latest request alone, results as calls of the
                  owner
packages          version of the installed package; imports of libraries that a plain installation leaves out
progress          types of functions that report progress
figures           figures of matplotlib as files, contact sheets
drawing           line drawings as data, SVG and PNG
fonts             the font of texts in pictures
former_names      names of packages up to 1.0, for files that import them
"""
