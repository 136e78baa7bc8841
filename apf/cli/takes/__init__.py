"""The takes of `apf track`: their jobs, files and messages."""
