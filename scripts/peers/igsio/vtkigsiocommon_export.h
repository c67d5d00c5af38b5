// Stands for the header that IGSIO's own build generates.
#define VTKIGSIOCOMMON_EXPORT
