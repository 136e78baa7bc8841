// Fills memory on a CPU, of which OpenCL's own command uses a single core. Twin: NumPy's fill; both
// are doors of cl/array.py.

// words: (n,) packs of 4, all set to `word`. An item per pack.
__kernel void fill_words(int n, uint word, __global uint4 *words)
{
    const int i = get_global_id(0);
    if (i < n) words[i] = (uint4)(word);
}
