// The test programs are run anew to unpack compressed pixels, as curlew is; gtest owns their main.
#include "acquisition/fits/unpacking_process.h"

namespace {

[[gnu::constructor]] void unpack_if_asked(int argc, char** argv) {
  curlew::serve_unpacking_if_asked(argc, argv);
}

}  // namespace
