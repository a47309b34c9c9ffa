// This describes the files in shared memory by which cacao, milk and other programs of
// ImageStreamIO pass images to each other: version "2.00", told in docs/cacao.md.
#pragma once

#include <semaphore.h>

#include <cstddef>
#include <cstdint>
#include <ctime>

namespace curlew {

/// These are the pixel types that Curlew reads or writes, by the numbers that the files have.
enum class StreamType : std::uint8_t { kU8 = 1, kU16 = 3, kF32 = 9, kF64 = 10 };

/// Returns the bytes of an element; 0 if it is none of StreamType.
std::size_t bytes_of(StreamType type);

/// Every file begins with this. Names are those of the format, not of Curlew.
struct StreamMetadata {
  char version[32];
  char name[80];
  std::uint8_t naxis;
  std::uint32_t size[3];  ///< fastest axis first
  std::uint64_t nelement;
  std::uint8_t datatype;
  std::uint64_t imagetype;
  timespec creationtime;
  timespec lastaccesstime;
  timespec atime;      ///< acquisition, CLOCK_TAI
  timespec writetime;  ///< last update, CLOCK_TAI
  std::int32_t creator_pid;
  std::int32_t owner_pid;
  std::uint8_t shared;
  std::uint64_t inode;
  std::int8_t location;  ///< −1: in the CPU's memory
  std::uint8_t status;
  std::uint64_t flag;
  std::uint8_t logflag;
  std::uint16_t sem;  ///< number of semaphores
  std::uint16_t traces;
  std::uint64_t cnt0;  ///< number of updates
  std::uint64_t cnt1;
  std::uint64_t cnt2;
  std::uint8_t write;  ///< 1 while the data change
  std::uint16_t keywords;
  std::uint32_t circular_size;
  std::uint32_t circular_index;
  std::uint64_t circular_cycle;
  std::uint64_t data_bytes;
  char cuda_handle[64];
};
static_assert(offsetof(StreamMetadata, size) == 116 && offsetof(StreamMetadata, datatype) == 136);
static_assert(offsetof(StreamMetadata, creationtime) == 152 &&
              offsetof(StreamMetadata, creator_pid) == 216);
static_assert(offsetof(StreamMetadata, inode) == 232 && offsetof(StreamMetadata, sem) == 258);
static_assert(offsetof(StreamMetadata, cnt0) == 264 && offsetof(StreamMetadata, write) == 288);
static_assert(offsetof(StreamMetadata, keywords) == 290 &&
              offsetof(StreamMetadata, data_bytes) == 312);
static_assert(sizeof(StreamMetadata) == 384);

struct StreamKeyword {
  char name[16];
  char type;  ///< L: number, S: text, N: not used
  union {
    std::int64_t number;
    char text[16];
  };
  char comment[80];
  std::uint64_t updates;
};
static_assert(sizeof(StreamKeyword) == 128 && offsetof(StreamKeyword, comment) == 40);
static_assert(sizeof(sem_t) == 32);

inline constexpr char kStreamVersion[] = "2.00";
inline constexpr std::uint16_t kStreamSemaphores = 10;
inline constexpr std::uint16_t kStreamTraces = 10;

/// Says at which byte of a file each part begins, and how long the file is.
struct StreamLayout {
  std::size_t data = 0;
  std::size_t keywords = 0;
  std::size_t semaphores = 0;
  std::size_t log_semaphore = 0;
  std::size_t read_pids = 0;
  std::size_t write_pids = 0;
  std::size_t bytes = 0;
};

/// metadata: its nelement, datatype, keywords, sem and traces are used. The data must be of a
/// StreamType and not circular.
StreamLayout layout_of(const StreamMetadata& metadata);

}  // namespace curlew
