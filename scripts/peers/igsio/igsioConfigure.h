// Stands for the header that IGSIO's own build generates. It selects no parts: no GPU.
