#include "acquisition/usb/usb_frame_assembler.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <atomic>
#include <bit>
#include <cstring>
#include <string>
#include <utility>

#include "core/as_size.h"
#include "core/error.h"

namespace curlew {
namespace {

static_assert(std::endian::native == std::endian::little, "pixels are copied as they come");

/// A longer leap of the frame number is damage, not loss.
constexpr std::uint32_t kLongestLeap = 65536;

void add(std::int64_t& count, std::int64_t by = 1) noexcept {
  std::atomic_ref(count).fetch_add(by, std::memory_order_relaxed);
}

int hex_digit(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  if (c >= 'A' && c <= 'F') return c - 'A' + 10;
  return -1;
}

std::vector<std::byte> sync_bytes(const std::string& text) {
  std::vector<std::byte> bytes;
  for (std::size_t i = 0; i < text.size(); i += 2) {
    const int high = hex_digit(text[i]);
    const int low = i + 1 < text.size() ? hex_digit(text[i + 1]) : -1;
    if (high < 0 || low < 0) {
      throw UsageError(fmt::format(
          "[usb] sync = \"{}\": write whole bytes as two hexadecimal digits each, as in a55a01ff",
          text));
    }
    bytes.push_back(static_cast<std::byte>(high * 16 + low));
  }
  return bytes;
}

/// Returns a list whose element n says: if n bytes of sync matched and the next did not, so many of
/// the last bytes are the beginning of sync again.
std::vector<std::size_t> shorter_matches(const std::vector<std::byte>& sync) {
  std::vector<std::size_t> shorter(sync.size() + 1, 0);
  for (std::size_t n = 1, match = 0; n < sync.size(); ++n) {
    while (match > 0 && sync[n] != sync[match]) match = shorter[match];
    if (sync[n] == sync[match]) ++match;
    shorter[n + 1] = match;
  }
  return shorter;
}

}  // namespace

FrameFormat usb_frame_format(const UsbLayout& layout) {
  if (layout.rows <= 0 || layout.cols <= 0) {
    throw UsageError(fmt::format(
        "[usb] rows = {} and cols = {}: a USB camera does not tell the size of its frames; set "
        "both, and bits, header_bytes and trailer_bytes, as its manual has them",
        layout.rows, layout.cols));
  }
  if (layout.bits != 8 && (layout.bits < 10 || layout.bits > 16)) {
    throw UsageError(fmt::format(
        "[usb] bits = {}: 8 (a byte a pixel) or 10 to 16 (two bytes a pixel)", layout.bits));
  }
  if (layout.header_bytes < 0 || layout.trailer_bytes < 0) {
    throw UsageError("[usb] header_bytes and trailer_bytes cannot be negative");
  }
  const std::size_t sync = sync_bytes(layout.sync).size();
  if (sync > as_size(layout.header_bytes)) {
    throw UsageError(
        fmt::format("[usb] sync is {} bytes and header_bytes = {}: sync is part of the "
                    "header, set header_bytes to all of it",
                    sync, layout.header_bytes));
  }
  if (layout.sequence_offset >= 0 && (layout.sequence_offset + 4 > layout.header_bytes ||
                                      as_size(layout.sequence_offset) < sync)) {
    throw UsageError(
        fmt::format("[usb] sequence_offset = {}: the 4 bytes of the frame number must lie in the "
                    "header of {} bytes, after the {} bytes of sync",
                    layout.sequence_offset, layout.header_bytes, sync));
  }
  FrameFormat format;
  format.rows = layout.rows;
  format.cols = layout.cols;
  format.pixel_type = layout.bits == 8 ? PixelType::kU8 : PixelType::kU16;
  return format;
}

std::size_t usb_frame_bytes(const UsbLayout& layout) {
  return as_size(layout.header_bytes) + usb_frame_format(layout).bytes() +
         as_size(layout.trailer_bytes);
}

UsbFrameAssembler::UsbFrameAssembler(const UsbLayout& layout, Empty empty, Deliver deliver)
    : header_bytes_(as_size(layout.header_bytes)),
      pixel_bytes_(usb_frame_format(layout).bytes()),
      frame_bytes_(usb_frame_bytes(layout)),
      rows_(layout.rows),
      sequence_offset_(layout.sequence_offset),
      sync_(sync_bytes(layout.sync)),
      shorter_match_(shorter_matches(sync_)),
      empty_(std::move(empty)),
      deliver_(std::move(deliver)),
      state_(sync_.empty() ? State::kBetween : State::kSearching),
      header_(sequence_offset_ < 0 ? 0 : as_size(layout.sequence_offset) + 4) {}

void UsbFrameAssembler::feed(Bytes bytes, bool ended_short, const Arrival& arrival) noexcept {
  arrival_ = arrival;
  while (!bytes.empty()) {
    if (state_ == State::kInFrame && after_short_) {
      if (could_be_restart(bytes)) continue;
      consume(Bytes(sync_).first(std::exchange(withheld_, 0)));
    }
    consume(std::exchange(bytes, {}));
  }
  if (ended_short) packet_was_short();
}

void UsbFrameAssembler::end() noexcept {
  if (state_ == State::kInFrame || full_) finish(Outcome::kAborted);
  full_ = after_short_ = false;
  withheld_ = matched_ = unframed_ = 0;
  state_ = sync_.empty() ? State::kBetween : State::kSearching;
}

FrameCounts UsbFrameAssembler::counts() const noexcept {
  FrameCounts counts;
  for (auto count : {&FrameCounts::delivered, &FrameCounts::incomplete, &FrameCounts::timed_out,
                     &FrameCounts::aborted, &FrameCounts::wrong_size, &FrameCounts::other,
                     &FrameCounts::lost, &FrameCounts::no_buffer}) {
    counts.*count = std::atomic_ref(counts_.*count).load(std::memory_order_relaxed);
  }
  return counts;
}

/// Decides whether a frame goes on after a short packet or a new one begins. True means that all
/// bytes looked at belong to a sync, as far as they go. False means that the frame goes on, first
/// with the bytes withheld.
bool UsbFrameAssembler::could_be_restart(Bytes& bytes) noexcept {
  const std::size_t n = std::min(bytes.size(), sync_.size() - withheld_);
  if (!std::equal(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(n),
                  sync_.begin() + static_cast<std::ptrdiff_t>(withheld_))) {
    after_short_ = false;
    return false;
  }
  withheld_ += n;
  bytes = bytes.subspan(n);
  if (withheld_ == sync_.size()) {
    finish(Outcome::kIncomplete);
    begin_frame();
    position_ = sync_.size();
  }
  return true;
}

void UsbFrameAssembler::consume(Bytes bytes) noexcept {
  while (!bytes.empty()) {
    switch (state_) {
      case State::kSearching:
        bytes = match_sync(bytes);
        break;
      case State::kBetween:
        if (!sync_.empty()) {
          bytes = match_sync(bytes);
        } else if (full_) {
          state_ = State::kOverlong;
        } else {
          begin_frame();
        }
        break;
      case State::kInFrame:
        bytes = fill(bytes);
        break;
      case State::kOverlong:
        return;
    }
  }
}

/// Looks for sync: right here if a frame has just ended, anywhere otherwise.
UsbFrameAssembler::Bytes UsbFrameAssembler::match_sync(Bytes bytes) noexcept {
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    ++unframed_;
    if (bytes[i] != sync_[matched_]) {
      if (full_) finish(Outcome::kWrongSize);
      full_ = false;
      state_ = State::kSearching;
      while (matched_ > 0 && bytes[i] != sync_[matched_]) matched_ = shorter_match_[matched_];
      if (bytes[i] != sync_[matched_]) continue;
    }
    if (++matched_ < sync_.size()) continue;
    if (full_) finish(Outcome::kWhole);
    full_ = false;
    const std::size_t skipped = unframed_ - sync_.size();
    if (started_ && sequence_offset_ < 0) {
      const auto frames = static_cast<std::int64_t>((skipped + frame_bytes_ / 2) / frame_bytes_);
      add(counts_.lost, frames);
      sequence_ += frames;
    }
    begin_frame();
    position_ = sync_.size();
    return bytes.subspan(i + 1);
  }
  return {};
}

UsbFrameAssembler::Bytes UsbFrameAssembler::fill(Bytes bytes) noexcept {
  const std::size_t n = std::min(bytes.size(), frame_bytes_ - position_);
  const std::size_t end = position_ + n;
  if (position_ < header_.size()) {
    std::memcpy(header_.data() + position_, bytes.data(),
                std::min(end, header_.size()) - position_);
  }
  const std::size_t first = std::max(position_, header_bytes_);
  const std::size_t last = std::min(end, header_bytes_ + pixel_bytes_);
  if (buffer_ != nullptr && first < last) {
    std::memcpy(buffer_->data() + (first - header_bytes_), bytes.data() + (first - position_),
                last - first);
  }
  position_ = end;
  if (position_ == frame_bytes_) {
    state_ = State::kBetween;
    full_ = true;
    full_at_ = arrival_;
    matched_ = unframed_ = 0;
  }
  return bytes.subspan(n);
}

void UsbFrameAssembler::packet_was_short() noexcept {
  consume(Bytes(sync_).first(std::exchange(withheld_, 0)));
  switch (state_) {
    case State::kSearching:
      break;
    case State::kBetween:
      // If bytes of the next sync are already here, the packet tells nothing of the frame before.
      if (full_ && matched_ == 0) {
        finish(Outcome::kWhole);
        full_ = false;
      }
      break;
    case State::kInFrame:
      if (sync_.empty()) {
        finish(Outcome::kIncomplete);
        state_ = State::kBetween;
      } else {
        after_short_ = true;
      }
      break;
    case State::kOverlong:
      finish(Outcome::kWrongSize);
      full_ = false;
      state_ = State::kBetween;
      break;
  }
}

void UsbFrameAssembler::begin_frame() noexcept {
  state_ = State::kInFrame;
  position_ = 0;
  matched_ = unframed_ = withheld_ = 0;
  after_short_ = false;
  if (buffer_ == nullptr) buffer_ = empty_();
}

void UsbFrameAssembler::finish(Outcome outcome) noexcept {
  const bool whole = outcome == Outcome::kWhole;
  const Number number = account(whole);
  if (number == Number::kMissing) return;
  if (number == Number::kInDoubt && whole) {
    add(counts_.other);
    return;
  }
  switch (outcome) {
    case Outcome::kWhole:
      if (buffer_ != nullptr) {
        deliver();
      } else {
        add(counts_.lost);
        add(counts_.no_buffer);
      }
      break;
    case Outcome::kIncomplete:
      add(counts_.incomplete);
      break;
    case Outcome::kWrongSize:
      add(counts_.wrong_size);
      break;
    case Outcome::kAborted:
      add(counts_.aborted);
      break;
  }
}

/// Gives the frame its sequence and counts what is missing before it. A frame whose number is
/// unknown gets none: it will be missing before the next one. One whose number does not follow is
/// in doubt: it takes the next sequence, and the numbers that come then are held against that.
UsbFrameAssembler::Number UsbFrameAssembler::account(bool whole) noexcept {
  if (!started_ && (!whole || buffer_ == nullptr)) return Number::kMissing;
  std::uint32_t number = 0;
  std::uint32_t leap = 1;
  if (sequence_offset_ >= 0) {
    if (position_ < header_.size()) return Number::kMissing;
    std::memcpy(&number, header_.data() + sequence_offset_, sizeof number);
    leap = number - number_;
    // A damaged frame's number proves nothing.
    if (started_ && !whole && leap > 1) return Number::kMissing;
    if (started_ && (leap == 0 || leap > kLongestLeap)) {
      const bool anew = doubtful_ && number == doubt_ + 1;
      doubtful_ = !anew;
      doubt_ = number;
      if (!anew) {
        ++in_doubt_;
        ++sequence_;
        return Number::kInDoubt;
      }
      leap = 1;
      in_doubt_ = 0;
      renumbered_ = true;
    }
  }
  if (started_) {
    const std::int64_t missing = std::int64_t{leap} - 1 - in_doubt_;
    if (missing < 0) renumbered_ = true;  // More frames came than numbers.
    add(counts_.lost, std::max<std::int64_t>(missing, 0));
    sequence_ += 1 + std::max<std::int64_t>(missing, 0);
  } else {
    sequence_ = number;
    delivered_ = sequence_ - 1;
    started_ = renumbered_ = true;
  }
  in_doubt_ = 0;
  doubtful_ = false;
  number_ = number;
  return Number::kKnown;
}

void UsbFrameAssembler::deliver() noexcept {
  FrameHeader& header = buffer_->header;
  header = {};
  header.sequence = sequence_;
  header.renumbered = std::exchange(renumbered_, false);
  header.received = full_at_.at;
  header.received_ns = full_at_.utc_ns;
  if (sequence_ != delivered_ + 1) header.status |= kFrameGapBefore;
  delivered_ = sequence_;
  buffer_->rows_ready.store(rows_, std::memory_order_release);
  add(counts_.delivered);
  buffer_ = deliver_(buffer_);
}

}  // namespace curlew
