// Where the sources and the programs of this build are. Only paths.cpp is compiled with these
// paths, so that a clone in another folder finds all other tests in the compiler's cache.
#pragma once

namespace curlew {

extern const char* const kSourceDir;
extern const char* const kFramesDir;      ///< real frames, beside the sources
extern const char* const kCurlewProgram;  ///< curlew
extern const char* const kServeGige;
extern const char* const kRecordForever;
extern const char* const kStreamReader;
extern const char* const kShiftedClock;  ///< a library to be preloaded
extern const char* const kFailingCalls;  ///< a library to be preloaded

}  // namespace curlew
