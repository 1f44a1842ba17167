"""General tools that know nothing of optics.

errors            `UserError`, the exception for a user's mistake, and suggestions of similar words
units             text with units such as "8 um" to SI numbers and back, without losing a digit
input_file        regular files as input, and text of a limited size
tables            tables of TOML and JSON from unknown sources: their keys, and the types of their values
file_schema       what the arrays and numbers of a file may be
memory_limit      how much memory may be taken, and the refusal of more
files             folders of shaders, presets and assets
file_writer       files written whole or not at all; `WriteError` for whatever a disk refuses
rescue            another place for a result that can't be written where it was wanted
text              text from files: a line that is safe to show, a plain name of a file
optional_library  imports of libraries that a plain installation leaves out
safetensors_file  named tensors with metadata in safetensors files, checked when they are read
latest_task       a worker thread that runs only the latest request
progress          types of functions that report progress
checkpoint        comparison of a checkpoint with the run that is to continue from it
signals           signals that ask the program to end; processes that end with their parent
threads           the end of a program whose threads may still be at work
control_groups    Linux's control groups, which limit processes
cpu_count         number of CPUs that this process may use
processor_share   which share of the processor this thread has got
openmp            how torch's threads wait for each other
version           version of the installed package
"""
