// Stands for IGSIO's header of the same name, which needs ITK: the parts that inserting a slice
// uses. Errors and warnings are written to stderr; messages of debugging are left out, as IGSIO's
// logger leaves them out at its default level.
#ifndef IGSIO_COMMON_H
#define IGSIO_COMMON_H

#include <cmath>
#include <iostream>
#include <sstream>
#include <string>
#include <vector>

#include <vtkObject.h>
#include <vtkSetGet.h>

enum igsioStatus { IGSIO_FAIL, IGSIO_SUCCESS };

#define LOG_ERROR(what) (std::cerr << "igsio: error: " << what << std::endl)
#define LOG_WARNING(what) (std::cerr << "igsio: warning: " << what << std::endl)
#define LOG_INFO(what) ((void)0)
#define LOG_DEBUG(what) ((void)0)
#define LOG_TRACE(what) ((void)0)

#endif
