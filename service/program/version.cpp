#include "service/program/version.h"

namespace curlew {

const char* const kProgram = "curlew " CURLEW_VERSION;
const char* const kBuildType = CURLEW_BUILD_TYPE;
const char* const kCompiler = CURLEW_COMPILER;

}  // namespace curlew
