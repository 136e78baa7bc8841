"""Hypotheses drawn and scored by OpenGL off-screen (Kwolek & Rymut 2016; Rymut 2016, 5.3 to 5.5).

Needs moderngl (the extra `opengl`) and a driver with EGL, such as Mesa's llvmpipe.
"""
