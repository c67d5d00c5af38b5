// Stands for the header that IGSIO's own build generates. The class is linked statically.
#define VTKVOLUMERECONSTRUCTION_EXPORT
