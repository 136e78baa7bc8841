"""The searches: annealed particle filter (Song et al. 2.3; Deutscher & Reid 2005), swarm and SIR
filter (Rymut 2016), and the refinement of their estimates."""
