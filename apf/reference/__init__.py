"""NumPy twins of the kernels: plain float64 code that specifies what the kernels compute. Folders
mirror those of `apf`."""
