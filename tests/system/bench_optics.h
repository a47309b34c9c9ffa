// The optics that the commands of tests give where they do not matter.
#pragma once

namespace curlew {

inline constexpr const char* kOptics =
    " --pitch-um 300 --focal-mm 10 --pixel-um 10 --wavelength-nm 633 ";

}  // namespace curlew
