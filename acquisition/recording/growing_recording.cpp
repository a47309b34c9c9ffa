#include "acquisition/recording/growing_recording.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <system_error>

#include "acquisition/fits/hdu_bytes.h"
#include "acquisition/fits/partial_path.h"
#include "core/as_size.h"
#include "core/error.h"

namespace curlew {
namespace {

constexpr std::int64_t kCard = 80;  // bytes
// FITS demands NAXIS3 as the sixth card of a cube's header, and NAXIS1 as the fourth of an
// extension's.
constexpr std::int64_t kNaxis3At = 5 * kCard;
constexpr std::int64_t kNaxis1At = 3 * kCard;
// The space for new frames is a hole in the file, which takes no space on the disk.
constexpr std::int64_t kMinSpare = std::int64_t{64} << 20;

std::int64_t size(const std::vector<std::byte>& bytes) {
  return static_cast<std::int64_t>(bytes.size());
}

std::span<const std::byte> as_bytes(const std::string& text) {
  return std::as_bytes(std::span(text.data(), text.size()));
}

}  // namespace

GrowingRecording::GrowingRecording(const std::string& path, const FrameFormat& format,
                                   const Optics& optics, const Detector& detector,
                                   const Provenance& provenance)
    : path_(path), format_(format), model_(FitsFile::create_in_memory(path)) {
  create_recording_image(model_, format, optics, detector, provenance, 0);
  head_bytes_ = static_cast<std::int64_t>(model_.memory().size());
  create_frame_table(model_);
  model_.create_image(ElementType::kU8, {0}, "UNFINISHED");
  encoded_.resize(format.bytes());

  std::error_code ignored;
  if (std::filesystem::exists(path_, ignored)) fail(EEXIST);
  partial_ = partial_path(path_);
  file_ = open(partial_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
  if (file_ < 0) fail(errno);
  committed_end_ = pending_end_ = head_bytes_;
  lay_out_tail();
  tail_end_ = head_bytes_ + size(tail_);
  try {
    write(model_.memory().first(as_size(head_bytes_)), 0);
    write(tail_, head_bytes_);
    resize(tail_end_ + spare_bytes_);
  } catch (const Failure&) {  // No destructor will run.
    close(file_);
    unlink(partial_.c_str());
    throw;
  }
}

GrowingRecording::~GrowingRecording() {
  // UNFINISHED's header is the tail's last block.
  const std::int64_t end = tail_is_whole_ ? tail_end_ - kFitsBlock : whole_blocks(committed_end_);
  // If this fails, the file is as a killed process leaves it: readable.
  [[maybe_unused]] const int result = ftruncate(file_, end);
  close(file_);
  if (!partial_.empty()) unlink(partial_.c_str());
}

std::int64_t GrowingRecording::bytes() const {
  const std::int64_t tail = tail_end_ - whole_blocks(committed_end_);
  return whole_blocks(pending_end_) + tail +
         whole_blocks(kFrameRowBytes * static_cast<std::int64_t>(pending_.size()));
}

GrowingRecording::Whereabouts GrowingRecording::whereabouts() const {
  struct stat ours {};
  struct stat named {};
  if (fstat(file_, &ours) == 0 && ours.st_nlink == 0) return Whereabouts::kRemoved;
  const std::string& name = partial_.empty() ? path_ : partial_;
  const bool is_here =
      stat(name.c_str(), &named) == 0 && named.st_dev == ours.st_dev && named.st_ino == ours.st_ino;
  return is_here ? Whereabouts::kHere : Whereabouts::kMoved;
}

void GrowingRecording::append(const FrameView& frame, const FrameHeader& header) {
  require_format(path_, format_, frame);
  encode(frame);
  const std::span<const std::byte> bytes = encoded_;
  // The part of the frame that belongs where the tail is has to wait.
  const std::int64_t tail_left = std::max<std::int64_t>(0, tail_end_ - pending_end_);
  const std::size_t hold = std::min(bytes.size(), as_size(tail_left));
  held_.insert(held_.end(), bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(hold));
  write(bytes.subspan(hold), pending_end_ + static_cast<std::int64_t>(hold));
  pending_end_ += static_cast<std::int64_t>(bytes.size());
  pending_.add(header);
  // This leaves half of the space for the next frame and the tail.
  if (pending_end_ > tail_end_ + spare_bytes_ / 2) commit();
}

// Writes the pixels big-endian into encoded_, 16 bits as signed numbers with BZERO 32768.
void GrowingRecording::encode(const FrameView& frame) {
  if (format_.pixel_type == PixelType::kU8) {
    std::memcpy(encoded_.data(), frame.pixels, encoded_.size());
    return;
  }
  const auto* from = frame.data<std::uint16_t>();
  auto* into = reinterpret_cast<std::uint16_t*>(encoded_.data());
  const std::size_t n = format_.pixels();
  for (std::size_t k = 0; k < n; ++k) {
    const std::uint32_t stored = from[k] ^ 0x8000U;
    into[k] = static_cast<std::uint16_t>(
        std::endian::native == std::endian::little ? stored << 8U | stored >> 8U : stored);
  }
}

// Makes tail_ of what follows the pending frames: zeros to the next block, the table with their
// rows, and UNFINISHED.
void GrowingRecording::lay_out_tail() {
  model_.select("FRAMES");
  write_frame_rows(model_, committed_, pending_);
  const std::span<const std::byte> model = model_.memory().subspan(as_size(head_bytes_));
  tail_.assign(as_size(whole_blocks(pending_end_) - pending_end_), std::byte{0});
  tail_.insert(tail_.end(), model.begin(), model.end());
  spare_bytes_ = whole_blocks(std::max({kMinSpare, 4 * size(encoded_), 4 * size(tail_)}));
  const std::string card = FitsFile::card("NAXIS1", spare_bytes_, "frames being written");
  std::memcpy(tail_.data() + tail_.size() - kFitsBlock + kNaxis1At, card.data(), card.size());
}

void GrowingRecording::commit() {
  if (pending_.size() == 0) return;
  lay_out_tail();
  const std::int64_t new_tail_end = pending_end_ + size(tail_);
  // If the frames are few, the new tail begins where the old one is; that part waits as well.
  const std::size_t hold =
      std::min(tail_.size(), as_size(std::max<std::int64_t>(0, tail_end_ - pending_end_)));
  held_.insert(held_.end(), tail_.begin(), tail_.begin() + static_cast<std::ptrdiff_t>(hold));
  write(std::span(tail_).subspan(hold), pending_end_ + static_cast<std::int64_t>(hold));
  resize(new_tail_end + spare_bytes_);

  tail_is_whole_ = false;
  write(held_, committed_end_);
  write(as_bytes(FitsFile::card("NAXIS3", frames(), "length of data axis 3")), kNaxis3At);
  tail_is_whole_ = true;
  if (!partial_.empty()) publish();

  committed_ = frames();
  committed_end_ = pending_end_;
  tail_end_ = new_tail_end;
  pending_.clear();
  held_.clear();
}

void GrowingRecording::publish() {
  int error = renameat2(AT_FDCWD, partial_.c_str(), AT_FDCWD, path_.c_str(), RENAME_NOREPLACE) == 0
                  ? 0
                  : errno;
  std::error_code ignored;
  // Some network file systems know only the plain rename.
  if (error == EINVAL && !std::filesystem::exists(path_, ignored)) {
    error = std::rename(partial_.c_str(), path_.c_str()) == 0 ? 0 : errno;
  }
  if (error != 0) fail(error);
  partial_.clear();
}

void GrowingRecording::write(std::span<const std::byte> bytes, std::int64_t offset) {
  while (!bytes.empty()) {
    const ssize_t n = pwrite(file_, bytes.data(), bytes.size(), offset);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) fail(n < 0 ? errno : ENOSPC);
    bytes = bytes.subspan(static_cast<std::size_t>(n));
    offset += n;
  }
}

void GrowingRecording::resize(std::int64_t bytes) {
  if (ftruncate(file_, bytes) != 0) fail(errno);
}

void GrowingRecording::fail(int error) const {
  throw Failure(path_ + " cannot be written: " + std::generic_category().message(error));
}

}  // namespace curlew
