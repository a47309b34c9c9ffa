// Pixels that are in their file as they are needed, but for the order of bytes. They are read past
// cfitsio, which copies them three times.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace curlew {

/// Reads parts of an open file, mostly one after the other, and asks the system for what comes
/// next, so that the disk works while the frame is worked on.
class SequentialReader {
 public:
  /// Fills `into` with the bytes from `place` on. Returns false where the file ends before, or
  /// cannot be read.
  bool read(int file, std::int64_t place, std::span<std::byte> into);
  /// Asks for what comes behind `place`, as if the bytes before had been read.
  void look_ahead(int file, std::int64_t place);

 private:
  std::int64_t asked_ = 0;  ///< all before this was asked for
};

/// Turns 16-bit integers from FITS's order of bytes into this machine's, and adds 32768 to each if
/// they are `shifted`, as unsigned ones are in FITS.
void order_bytes(std::span<std::uint16_t> pixels, bool shifted);

}  // namespace curlew
