"""The studies: each module holds one as `STUDY`, which `holoview study` finds."""
