#include "tests/support/paths.h"

namespace curlew {

const char* const kSourceDir = CURLEW_SOURCE_DIR;
const char* const kFramesDir = CURLEW_SOURCE_DIR "/../shared/frames";
const char* const kCurlewProgram = CURLEW_PROGRAM;
const char* const kServeGige = CURLEW_SERVE_GIGE;
const char* const kRecordForever = CURLEW_RECORD_FOREVER;
const char* const kStreamReader = CURLEW_STREAM_READER;
const char* const kShiftedClock = CURLEW_SHIFTED_CLOCK;
const char* const kFailingCalls = CURLEW_FAILING_CALLS;

}  // namespace curlew
