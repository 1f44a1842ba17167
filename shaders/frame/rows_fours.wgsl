// Stored rows whose samples are accessed four at a time, each a 64-bit integer. A driver that executes shaders on the
// CPU turns each access into a loop over the lanes of a vector.

alias RowElement = vec4<u64>;
