#include "acquisition/aravis/aravis_receiver.h"

#include <algorithm>
#include <bit>
#include <cstring>
#include <limits>
#include <utility>

#include "core/utc_now.h"

namespace curlew {
namespace {

// Aravis sets a buffer's number when the frame's first packet arrives. If that packet is lost, the
// number of the frame before would stay, so it is overwritten in advance by this one.
constexpr std::uint64_t kNoNumber = std::numeric_limits<std::uint64_t>::max();

constexpr int kFramesToWatch = 20;

}  // namespace

AravisReceiver::AravisReceiver(const PixelCoding& coding, const FrameFormat& format,
                               std::size_t payload_bytes, std::size_t staging,
                               bool ids_wrap_at_16_bits, ThreadStart thread_start)
    : coding_(coding),
      format_(format),
      payload_bytes_(payload_bytes),
      staging_(coding.packing == Packing::kNone && payload_bytes == format.bytes() ? 0 : staging),
      thread_start_(std::move(thread_start)),
      numbering_(ids_wrap_at_16_bits) {}

void AravisReceiver::begin(FrameExchange& exchange) {
  exchange_ = &exchange;
  slots_.reserve(staging_ > 0 ? staging_ : exchange.buffers());
  numbering_.restart();
  gap_ = false;
  underruns_ = 0;
}

void AravisReceiver::feed(ArvStream* stream) {
  reserve_ = own_memory();
  for (std::size_t i = 0; i < staging_; ++i) {
    slots_.push_back(own_memory());
    push(stream, *slots_.back());
  }
  push_returned(stream);
  if (in_stream_ == 0) push(stream, *reserve_);
  stream_.store(stream, std::memory_order_release);
}

std::unique_ptr<AravisReceiver::Slot> AravisReceiver::own_memory() const {
  auto slot = std::make_unique<Slot>();
  slot->buffer.reset(arv_buffer_new_full(payload_bytes_, nullptr, slot.get(), nullptr));
  return slot;
}

void AravisReceiver::wait_for_thread() const noexcept { thread_runs_.wait(true); }

void AravisReceiver::end() noexcept {
  if (exchange_ == nullptr) return;
  for (const auto& slot : slots_)
    if (slot->in_stream && slot->frame != nullptr) exchange_->put_back(slot->frame);
  if (spare_ != nullptr) exchange_->put_back(std::exchange(spare_, nullptr));
  slots_.clear();
  reserve_.reset();
  in_stream_ = 0;
  exchange_ = nullptr;
  stream_.store(nullptr, std::memory_order_release);
}

void AravisReceiver::on_stream_event(void* receiver, ArvStreamCallbackType event, ArvBuffer*) {
  auto& self = *static_cast<AravisReceiver*>(receiver);
  ArvStream* stream = self.stream_.load(std::memory_order_acquire);
  switch (event) {
    case ARV_STREAM_CALLBACK_TYPE_INIT:
      self.thread_runs_.store(true);
      if (self.thread_start_) self.thread_start_();
      break;
    case ARV_STREAM_CALLBACK_TYPE_START_BUFFER:
      if (stream != nullptr) self.push_returned(stream);
      break;
    case ARV_STREAM_CALLBACK_TYPE_BUFFER_DONE:
      if (stream == nullptr) break;
      while (ArvBuffer* buffer = arv_stream_try_pop_buffer(stream)) self.take_done(stream, buffer);
      self.push_returned(stream);
      if (self.in_stream_ == 0) self.push(stream, *self.reserve_);
      break;
    case ARV_STREAM_CALLBACK_TYPE_EXIT:
      self.thread_runs_.store(false);
      self.thread_runs_.notify_all();
      break;
  }
}

void AravisReceiver::take_done(ArvStream* stream, ArvBuffer* buffer) noexcept {
  const auto received = std::chrono::steady_clock::now();
  auto& slot = *static_cast<Slot*>(const_cast<void*>(arv_buffer_get_user_data(buffer)));
  g_object_unref(buffer);  // This was the stream's reference; the slot has its own.
  slot.in_stream = false;
  --in_stream_;

  FrameHeader header;
  header.received = received;
  header.received_ns = utc_now_ns();
  header.camera_ns = static_cast<std::int64_t>(arv_buffer_get_timestamp(buffer));
  const std::uint64_t id = arv_buffer_get_frame_id(buffer);
  number(stream, id, header);

  Cause cause = cause_of(arv_buffer_get_status(buffer));
  if (cause == kDelivered && id == kNoNumber) cause = kOther;
  if (cause == kDelivered && !has_agreed_shape(buffer)) cause = kWrongSize;
  FrameBuffer* frame = cause == kDelivered ? filled_frame(slot) : nullptr;
  if (frame != nullptr) {
    header.renumbered = std::exchange(renumbered_, false);
    if (std::exchange(gap_, false) && !header.renumbered) header.status |= kFrameGapBefore;
    frame->header = header;
    frame->rows_ready.store(format_.rows, std::memory_order_release);
    watch_bits(*frame);
    count(kDelivered);
    FrameBuffer* superseded = exchange_->deliver(frame);
    if (superseded != nullptr) push_frame(stream, superseded);
    if (slot.frame == nullptr) recycle(stream, slot);
  } else {
    gap_ = true;
    if (cause == kDelivered) {  // It is whole, but no buffer is free for it.
      cause = kLost;
      count(kNoBuffer);
    }
    count(cause);
    recycle(stream, slot);
  }
}

bool AravisReceiver::has_agreed_shape(ArvBuffer* buffer) const noexcept {
  if (arv_buffer_get_n_parts(buffer) == 0 ||
      arv_buffer_get_part_data_type(buffer, 0) != ARV_BUFFER_PART_DATA_TYPE_2D_IMAGE)
    return false;
  std::size_t bytes = 0;
  arv_buffer_get_data(buffer, &bytes);
  return arv_buffer_get_part_pixel_format(buffer, 0) == coding_.code &&
         arv_buffer_get_part_width(buffer, 0) == format_.cols &&
         arv_buffer_get_part_height(buffer, 0) == format_.rows &&
         bytes >= coding_.bytes(format_.pixels());
}

void AravisReceiver::number(ArvStream* stream, std::uint64_t id, FrameHeader& header) noexcept {
  if (id == kNoNumber) {
    numbering_.unnumbered();
    return;
  }
  const FrameNumbering::Arrival arrival = numbering_.numbered(id);
  header.sequence = arrival.sequence;
  if (arrival.renumbered) renumbered_ = true;
  if (arrival.lost == 0) return;
  gap_ = true;
  count(kLost, arrival.lost);
  // Aravis counts the packets that found no buffer, so it tells whether frames were lost for want
  // of one, and not how many.
  guint64 underruns = 0;
  arv_stream_get_statistics(stream, nullptr, nullptr, &underruns);
  if (underruns != underruns_) count(kNoBuffer, arrival.lost);
  underruns_ = underruns;
}

FrameBuffer* AravisReceiver::filled_frame(Slot& slot) noexcept {
  if (slot.frame != nullptr) return slot.frame;
  if (spare_ == nullptr) spare_ = exchange_->empty();
  if (spare_ == nullptr) return nullptr;
  copy_pixels(slot.buffer.get(), *spare_);
  return std::exchange(spare_, nullptr);
}

void AravisReceiver::copy_pixels(ArvBuffer* buffer, FrameBuffer& frame) const noexcept {
  const auto* from = static_cast<const std::byte*>(arv_buffer_get_part_data(buffer, 0, nullptr));
  std::size_t bytes = 0;
  arv_buffer_get_data(buffer, &bytes);
  gint padding = 0;
  gint rows_padding = 0;
  arv_buffer_get_part_padding(buffer, 0, &padding, &rows_padding);
  // Without padding the lines follow each other, even in the middle of a byte. Padding that the
  // bytes which came have no room for is not there.
  const auto rows = static_cast<std::size_t>(format_.rows);
  const std::size_t line = coding_.bytes(static_cast<std::size_t>(format_.cols));
  const std::size_t stride = line + static_cast<std::size_t>(std::max(padding, 0));
  const bool one_run = stride == line || (rows - 1) * stride + line > bytes;
  const std::size_t runs = one_run ? 1 : rows;
  const std::size_t pixels = format_.pixels() / runs;
  const std::size_t run_bytes = pixels * static_cast<std::size_t>(format_.pixel_type);
  for (std::size_t i = 0; i < runs; ++i) {
    std::byte* to = frame.data() + i * run_bytes;
    if (coding_.packing == Packing::kNone)
      std::memcpy(to, from + i * stride, run_bytes);
    else
      unpack_pixels(coding_, from + i * stride, pixels, reinterpret_cast<std::uint16_t*>(to));
  }
}

void AravisReceiver::watch_bits(const FrameBuffer& frame) noexcept {
  const int watched = frames_watched_.load(std::memory_order_relaxed);
  if (watched >= kFramesToWatch || coding_.bits == 8 || coding_.packing != Packing::kNone) return;
  const auto* pixels = frame.view().data<std::uint16_t>();
  unsigned used = 0;
  for (std::size_t i = 0; i < format_.pixels(); ++i) used |= pixels[i];
  used_bits_.fetch_or(used, std::memory_order_relaxed);
  frames_watched_.store(watched + 1, std::memory_order_release);
}

std::string AravisReceiver::justification() const {
  if (frames_watched_.load(std::memory_order_acquire) < kFramesToWatch) return {};
  const unsigned used = used_bits_.load(std::memory_order_relaxed);
  const int lowest = std::countr_zero(used);
  if (used == 0 || (used & 0xFFFFU) == 0xFFFFU) return {};
  if (lowest > 0)
    return "pixels use the upper " + std::to_string(16 - lowest) +
           " of 16 bits: values are multiples of " + std::to_string(1U << lowest);
  const int width =
      std::max(static_cast<int>(std::bit_width(used)), coding_.bits < 16 ? coding_.bits : 0);
  return width < 16 ? "pixels use the lower " + std::to_string(width) + " of 16 bits"
                    : std::string();
}

void AravisReceiver::push(ArvStream* stream, Slot& slot) noexcept {
  ArvBuffer* buffer = slot.buffer.get();
  arv_buffer_set_frame_id(buffer, kNoNumber);
  slot.in_stream = true;
  ++in_stream_;
  g_object_ref(buffer);
  arv_stream_push_buffer(stream, buffer);
}

void AravisReceiver::recycle(ArvStream* stream, Slot& slot) noexcept {
  if (&slot != reserve_.get()) push(stream, slot);
}

void AravisReceiver::push_returned(ArvStream* stream) noexcept {
  if (staging_ > 0) {
    if (spare_ == nullptr) spare_ = exchange_->empty();
    return;
  }
  while (FrameBuffer* frame = exchange_->empty()) push_frame(stream, frame);
}

void AravisReceiver::push_frame(ArvStream* stream, FrameBuffer* frame) noexcept {
  if (staging_ > 0) {
    spare_ == nullptr ? void(spare_ = frame) : exchange_->put_back(frame);
    return;
  }
  const auto is_its = [&](const auto& slot) { return slot->frame == frame; };
  auto slot = std::find_if(slots_.begin(), slots_.end(), is_its);
  if (slot == slots_.end()) {  // This happens once for every buffer.
    slots_.push_back(std::make_unique<Slot>());
    slot = std::prev(slots_.end());
    (*slot)->frame = frame;
    (*slot)->buffer.reset(arv_buffer_new_full(payload_bytes_, frame->data(), slot->get(), nullptr));
  }
  push(stream, **slot);
}

AravisReceiver::Cause AravisReceiver::cause_of(ArvBufferStatus status) noexcept {
  switch (status) {
    case ARV_BUFFER_STATUS_SUCCESS:
      return kDelivered;
    case ARV_BUFFER_STATUS_MISSING_PACKETS:
      return kIncomplete;
    case ARV_BUFFER_STATUS_TIMEOUT:
      return kTimedOut;
    case ARV_BUFFER_STATUS_ABORTED:
      return kAborted;
    case ARV_BUFFER_STATUS_WRONG_PACKET_ID:  // It had more packets than the payload.
    case ARV_BUFFER_STATUS_SIZE_MISMATCH:
      return kWrongSize;
    default:
      return kOther;
  }
}

void AravisReceiver::count(Cause cause, std::int64_t frames) noexcept {
  counts_[cause].fetch_add(frames, std::memory_order_relaxed);
}

FrameCounts AravisReceiver::counts() const noexcept {
  const auto of = [&](Cause cause) { return counts_[cause].load(std::memory_order_relaxed); };
  return {of(kDelivered), of(kIncomplete), of(kTimedOut),
          of(kAborted),   of(kWrongSize),  of(kOther),
          of(kLost),      of(kNoBuffer),   0};
}

}  // namespace curlew
