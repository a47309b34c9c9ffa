// The program's name and version, as files and reports state them.
#pragma once

namespace curlew {

extern const char* const kProgram;    ///< "curlew 0.1.0"
extern const char* const kBuildType;  ///< the build type of CMake
extern const char* const kCompiler;

}  // namespace curlew
