// Stands for ITK's header: IGSIO's mathematics name the type, and inserting a slice does not use it.
#pragma once
template <class T> class vnl_sparse_matrix;
