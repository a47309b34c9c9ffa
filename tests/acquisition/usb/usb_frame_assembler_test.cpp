#include "acquisition/usb/usb_frame_assembler.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>
#include <utility>

#include "core/error.h"
#include "tests/acquisition/usb/usb_stream.h"
#include "tests/support/allocation_counter.h"

namespace curlew {
namespace {

/// Holds the bytes on the wire and the places where a short packet ends.
struct Wire {
  Bytes bytes;
  std::set<std::size_t> short_ends;

  void send(const Bytes& more, bool ends_short) {
    bytes.insert(bytes.end(), more.begin(), more.end());
    if (ends_short) short_ends.insert(bytes.size());
  }
};

/// Feeds the whole wire, cut wherever a short packet ends and at `cuts`.
void feed(Collector& collector, const Wire& wire, std::set<std::size_t> cuts) {
  cuts.insert(wire.short_ends.begin(), wire.short_ends.end());
  cuts.insert(wire.bytes.size());
  std::size_t at = 0;
  for (const std::size_t cut : cuts) {
    collector.feed(Bytes(wire.bytes.begin() + static_cast<std::ptrdiff_t>(at),
                         wire.bytes.begin() + static_cast<std::ptrdiff_t>(cut)),
                   wire.short_ends.contains(cut));
    at = cut;
  }
}

auto as_tuple(const FrameCounts& c) {
  return std::tuple(c.delivered, c.incomplete, c.timed_out, c.aborted, c.wrong_size, c.other,
                    c.lost, c.no_buffer);
}

/// Expects that every number from the first frame delivered to the last one is in exactly one
/// count.
void expect_identity(const Collector& collector) {
  ASSERT_FALSE(collector.frames.empty());
  const FrameCounts counts = collector.counts();
  EXPECT_EQ(counts.delivered, static_cast<std::int64_t>(collector.frames.size()));
  EXPECT_EQ(collector.frames.back().sequence - collector.frames.front().sequence + 1,
            counts.delivered + counts.dropped());
  EXPECT_LE(counts.no_buffer, counts.lost);
}

struct Kind {
  const char* name;
  bool sync, numbered, short_packets;
};
constexpr Kind kKinds[] = {{"sync, number, one stream", true, true, false},
                           {"sync, number, short packets", true, true, true},
                           {"sync, one stream", true, false, false},
                           {"sync, short packets", true, false, true},
                           {"number, short packets", false, true, true},
                           {"short packets", false, false, true}};

TEST(UsbFrameAssembler, DeliversEveryFrameOfAnUndamagedStream) {
  for (const Kind& kind : kKinds) {
    for (const int bits : {8, 10, 12, 16}) {
      SCOPED_TRACE(std::string(kind.name) + ", bits " + std::to_string(bits));
      const UsbLayout layout = stream_layout(bits, kind.sync, kind.numbered);
      Collector collector(layout);
      for (std::uint32_t n = 100; n < 120; ++n) {
        collector.feed(stream_frame(layout, n), kind.short_packets);
      }
      // Without short packets the last frame's end is not known before the next one begins.
      const std::size_t whole = kind.short_packets ? 20 : 19;
      ASSERT_EQ(collector.frames.size(), whole);
      for (std::size_t i = 0; i < whole; ++i) {
        const Delivered& frame = collector.frames[i];
        EXPECT_EQ(frame.sequence, static_cast<std::int64_t>(i + (kind.numbered ? 100 : 0)));
        EXPECT_EQ(frame.renumbered, i == 0);
        EXPECT_EQ(frame.status, kFrameOk);
        EXPECT_EQ(frame.pixels, stream_pixels(layout, static_cast<std::uint32_t>(100 + i)));
      }
      EXPECT_EQ(collector.counts().dropped(), 0);
      collector.assembler().end();
      EXPECT_EQ(collector.counts().aborted, kind.short_packets ? 0 : 1);
    }
  }
}

TEST(UsbFrameAssembler, AnyChunkingGivesTheSameFrames) {
  const unsigned seed = std::random_device{}();
  RecordProperty("seed", std::to_string(seed));
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  for (const Kind& kind : kKinds) {
    SCOPED_TRACE(kind.name);
    const UsbLayout layout = stream_layout(8, kind.sync, kind.numbered);
    Wire wire;
    std::uint32_t number = 7;
    for (int i = 0; i < 60; ++i, ++number) {
      Bytes frame = stream_frame(layout, number);
      const std::size_t at = random() % frame.size();
      const auto place = frame.begin() + static_cast<std::ptrdiff_t>(at);
      switch (random() % 10) {
        case 0:
          frame.erase(place,
                      place + static_cast<std::ptrdiff_t>(1 + random() % (frame.size() - at)));
          break;
        case 1:
          frame.insert(place, 1 + random() % 300, 0xa5);  // It begins as sync does.
          break;
        case 2:
          frame[at] ^= 0xff;
          break;
        case 3:
          number += static_cast<std::uint32_t>(random() % 5);
          break;
        case 4:  // This is a short packet in mid-frame.
          if (kind.sync) {
            wire.send(Bytes(frame.begin(), place), true);
            frame.erase(frame.begin(), place);
          }
          break;
        default:
          break;
      }
      wire.send(frame, kind.short_packets);
    }
    // The stream ends well, so that the last frame accounted for is the last one delivered.
    for (int i = 0; i < 4; ++i) wire.send(stream_frame(layout, ++number), kind.short_packets);
    Collector whole(layout);
    feed(whole, wire, {});
    EXPECT_GT(whole.frames.size(), 15U);
    EXPECT_GT(whole.counts().dropped(), 0);
    expect_identity(whole);
    for (int round = 0; round < 40; ++round) {
      std::set<std::size_t> cuts;
      const std::size_t pieces = round == 0 ? wire.bytes.size() : random() % 500;
      for (std::size_t i = 0; i < pieces; ++i) {
        cuts.insert(round == 0 ? i : random() % wire.bytes.size());
      }
      cuts.erase(0);
      Collector cut(layout);
      feed(cut, wire, cuts);
      ASSERT_EQ(cut.frames, whole.frames) << "round " << round;
      ASSERT_EQ(as_tuple(cut.counts()), as_tuple(whole.counts())) << "round " << round;
    }
  }
}

/// Damages one frame of twelve, at each of its bytes. What is delivered must always be right, and
/// all frames must be there except the damaged one and, without short packets, its neighbours.
template <typename Damage>
void damage_everywhere(Damage&& damage) {
  for (const Kind& kind : kKinds) {
    const UsbLayout layout = stream_layout(8, kind.sync, kind.numbered);
    const std::size_t bytes = usb_frame_bytes(layout);
    for (std::size_t at = 0; at < bytes; ++at) {
      SCOPED_TRACE(std::string(kind.name) + ", byte " + std::to_string(at));
      Wire wire;
      for (std::uint32_t n = 0; n < 12; ++n) {
        Bytes frame = stream_frame(layout, n);
        if (n == 4 && !damage(frame, at, kind)) break;
        wire.send(frame, kind.short_packets);
      }
      if (wire.bytes.size() < 10 * bytes) continue;  // There is no damage of this sort here.
      Collector collector(layout);
      feed(collector, wire, {});
      std::set<std::uint32_t> seen;
      for (const Delivered& frame : collector.frames) {
        std::uint32_t number = 0;
        while (number < 12 && frame.pixels != stream_pixels(layout, number)) ++number;
        ASSERT_LT(number, 12U) << "a damaged frame was delivered as frame " << frame.sequence;
        EXPECT_TRUE(!kind.numbered || frame.sequence == number) << frame.sequence;
        seen.insert(number);
      }
      EXPECT_FALSE(seen.contains(4));
      for (const std::uint32_t n : {0U, 1U, 2U, 6U, 7U, 8U, 9U, 10U}) {
        EXPECT_TRUE(seen.contains(n)) << "frame " << n;
      }
      // Short packets tell where frames end, whatever the next one looks like. Without them a frame
      // is known to be whole only by the sync after it, and damage may reach into the next.
      EXPECT_TRUE(seen.contains(3) || (!kind.short_packets && at < 4));
      EXPECT_TRUE(seen.contains(5) || !kind.short_packets);
      EXPECT_GE(collector.counts().dropped(), 1);
      expect_identity(collector);
    }
  }
}

TEST(UsbFrameAssembler, AByteLostAnywhereCostsNoOtherFrame) {
  damage_everywhere([](Bytes& frame, std::size_t at, const Kind&) {
    frame.erase(frame.begin() + static_cast<std::ptrdiff_t>(at));
    return true;
  });
}

TEST(UsbFrameAssembler, ManyBytesLostAnywhereCostNoOtherFrame) {
  damage_everywhere([](Bytes& frame, std::size_t at, const Kind&) {
    const auto place = frame.begin() + static_cast<std::ptrdiff_t>(at);
    frame.erase(place,
                place + static_cast<std::ptrdiff_t>(std::min<std::size_t>(64, frame.size() - at)));
    return true;
  });
}

TEST(UsbFrameAssembler, AByteTooManyAnywhereCostsNoOtherFrame) {
  damage_everywhere([](Bytes& frame, std::size_t at, const Kind& kind) {
    if (kind.sync && at == 0) return false;  // That byte is not in the frame.
    frame.insert(frame.begin() + static_cast<std::ptrdiff_t>(at), 0x5a);
    return true;
  });
}

TEST(UsbFrameAssembler, AWrongSyncCostsNoOtherFrame) {
  damage_everywhere([](Bytes& frame, std::size_t at, const Kind& kind) {
    if (!kind.sync || at >= 4) return false;
    frame[at] ^= 0x10;
    return true;
  });
}

TEST(UsbFrameAssembler, ADamagedNumberIsNotTakenForALoss) {
  const UsbLayout layout = stream_layout();
  for (const std::uint32_t wrong : {0x80000005U, 3U, 0x00100005U, 4U}) {
    SCOPED_TRACE(wrong);
    Collector collector(layout);
    for (std::uint32_t n = 0; n < 10; ++n) {
      Bytes frame = stream_frame(layout, n);
      if (n == 5) std::memcpy(frame.data() + 8, &wrong, sizeof wrong);
      collector.feed(frame, true);
    }
    EXPECT_EQ(collector.frames.size(), 9U);
    EXPECT_EQ(collector.counts().lost, 0);
    EXPECT_EQ(collector.counts().other, 1) << "the frame came, and is in doubt";
    EXPECT_EQ(collector.frames[5].sequence, 6);
    EXPECT_EQ(collector.frames[5].status, kFrameGapBefore);
    expect_identity(collector);
  }
}

// What there is of the number before is not taken for its number.
TEST(UsbFrameAssembler, AFrameThatIsCutOffInItsNumberHasNone) {
  const UsbLayout layout = stream_layout();
  for (const std::ptrdiff_t bytes : {4, 8, 9, 11}) {
    SCOPED_TRACE(bytes);
    Collector collector(layout);
    for (const std::uint32_t n : {1U, 2U, 3U}) collector.feed(stream_frame(layout, n), true);
    const Bytes noise = stream_frame(layout, 0x01010104U);
    collector.feed(Bytes(noise.begin(), noise.begin() + bytes), true);
    for (const std::uint32_t n : {4U, 5U, 7U}) collector.feed(stream_frame(layout, n), true);
    ASSERT_EQ(collector.frames.size(), 6U);
    EXPECT_EQ(collector.frames[3].sequence, 4);
    EXPECT_FALSE(collector.frames[3].renumbered);
    EXPECT_EQ(collector.counts().dropped(), 1) << "only frame 6 did not come";
    EXPECT_EQ(collector.counts().lost, 1);
    expect_identity(collector);
  }
}

TEST(UsbFrameAssembler, NumbersThatNeverCameAreLost) {
  Collector collector(stream_layout());
  collector.feed_numbered({1U, 2U, 7U, 8U, 1000U, 1001U});
  ASSERT_EQ(collector.frames.size(), 6U);
  EXPECT_EQ(collector.counts().lost, 4 + 991);
  for (std::size_t i = 0; i < 6; ++i) {
    EXPECT_EQ(collector.frames[i].status, i == 2 || i == 4 ? kFrameGapBefore : kFrameOk);
  }
  expect_identity(collector);
}

TEST(UsbFrameAssembler, CountsOnThroughTheWrapOfTheNumber) {
  Collector collector(stream_layout());
  collector.feed_numbered({0xfffffffdU, 0xfffffffeU, 0xffffffffU, 0U, 1U, 3U});
  ASSERT_EQ(collector.frames.size(), 6U);
  EXPECT_EQ(collector.frames[3].sequence, 0x100000000);
  EXPECT_EQ(collector.frames[5].sequence, 0x100000003);
  EXPECT_EQ(collector.counts().lost, 1);
  expect_identity(collector);
}

TEST(UsbFrameAssembler, NumbersThatBeginAnewAreFollowed) {
  Collector collector(stream_layout());
  collector.feed_numbered({5000U, 5001U, 0U, 1U, 2U, 4U});
  // Frame 0 is in doubt until 1 follows it.
  ASSERT_EQ(collector.frames.size(), 5U);
  EXPECT_EQ(collector.frames[2].pixels, stream_pixels(stream_layout(), 1));
  EXPECT_TRUE(collector.frames[2].renumbered);
  EXPECT_FALSE(collector.frames[3].renumbered);
  EXPECT_EQ(collector.counts().other, 1);
  EXPECT_EQ(collector.counts().lost, 1);
  expect_identity(collector);
}

// Whatever a camera counts by, each frame that came is in one column of the books.
TEST(UsbFrameAssembler, NumbersThatMakeNoSenseLeaveNoFrameOut) {
  constexpr std::uint32_t kFrames = 1000;
  struct Counting {
    const char* name;
    std::uint32_t (*number)(std::uint32_t n);
    std::int64_t delivered;
  };
  const Counting countings[] = {{"constant", [](std::uint32_t) { return 7U; }, 1},
                                {"doubled", [](std::uint32_t n) { return n / 2; }, kFrames / 2},
                                {"leaping", [](std::uint32_t n) { return n * 1'000'003U; }, 1},
                                {"backwards", [](std::uint32_t n) { return 5000U - n; }, 1}};
  for (const Counting& counting : countings) {
    SCOPED_TRACE(counting.name);
    Collector collector(stream_layout());
    for (std::uint32_t n = 0; n < kFrames; ++n)
      collector.feed(stream_frame(stream_layout(), counting.number(n)), true);
    const FrameCounts counts = collector.counts();
    EXPECT_EQ(counts.delivered, counting.delivered);
    EXPECT_EQ(counts.delivered + counts.other, kFrames);
    EXPECT_EQ(counts.dropped(), counts.other) << "none was lost";
    collector.feed(stream_frame(stream_layout(), counting.number(kFrames - 1) + 1), true);
    collector.feed(stream_frame(stream_layout(), counting.number(kFrames - 1) + 2), true);
    expect_identity(collector);
  }
}

TEST(UsbFrameAssembler, JoinsAStreamInTheMiddle) {
  for (const Kind& kind : kKinds) {
    SCOPED_TRACE(kind.name);
    const UsbLayout layout = stream_layout(16, kind.sync, kind.numbered);
    Collector collector(layout);
    const Bytes first = stream_frame(layout, 0);
    collector.feed(Bytes(first.begin() + 100, first.end()), kind.short_packets);
    for (std::uint32_t n = 1; n < 5; ++n) {
      collector.feed(stream_frame(layout, n), kind.short_packets);
    }
    ASSERT_GE(collector.frames.size(), 3U);
    EXPECT_EQ(collector.frames[0].pixels, stream_pixels(layout, 1));
    EXPECT_TRUE(collector.frames[0].renumbered);
    EXPECT_EQ(collector.frames[0].status, kFrameOk);
    EXPECT_EQ(collector.counts().dropped(), 0);
  }
}

TEST(UsbFrameAssembler, PixelsThatLookLikeSyncDoNoHarm) {
  UsbLayout layout = stream_layout(8);
  layout.sync = "a5a5ff";
  for (const bool short_packets : {false, true}) {
    Collector collector(layout);
    for (std::uint32_t n = 0; n < 8; ++n) {
      Bytes frame = stream_frame(layout, n);
      for (std::size_t i = 16; i + 6 < frame.size(); i += 3) {
        frame[i] = frame[i + 1] = 0xa5;
        frame[i + 2] = 0xff;
      }
      collector.feed(frame, short_packets);
    }
    EXPECT_GE(collector.frames.size(), 7U);
    EXPECT_EQ(collector.counts().dropped(), 0);
  }
}

TEST(UsbFrameAssembler, ShortPacketsAnywhereDoNoHarmWhereThereIsSync) {
  const UsbLayout layout = stream_layout(8);
  const std::size_t bytes = usb_frame_bytes(layout);
  for (std::size_t cut = 0; cut <= bytes; ++cut) {
    Collector collector(layout);
    for (std::uint32_t n = 0; n < 4; ++n) {
      const Bytes frame = stream_frame(layout, n);
      collector.feed(Bytes(frame.begin(), frame.begin() + static_cast<std::ptrdiff_t>(cut)), true);
      collector.feed(Bytes(frame.begin() + static_cast<std::ptrdiff_t>(cut), frame.end()), true);
    }
    ASSERT_EQ(collector.frames.size(), 4U) << "short packet after byte " << cut;
    for (std::uint32_t n = 0; n < 4; ++n) {
      ASSERT_EQ(collector.frames[n].pixels, stream_pixels(layout, n));
    }
    EXPECT_EQ(collector.counts().dropped(), 0);
  }
}

TEST(UsbFrameAssembler, AFrameCutShortIsIncompleteAndOneTooLongIsOfWrongSize) {
  for (const Kind& kind : kKinds) {
    if (!kind.short_packets) continue;
    SCOPED_TRACE(kind.name);
    const UsbLayout layout = stream_layout(16, kind.sync, kind.numbered);
    Collector collector(layout);
    for (std::uint32_t n = 0; n < 8; ++n) {
      Bytes frame = stream_frame(layout, n);
      if (n == 3) frame.resize(frame.size() / 2);
      if (n == 5) frame.resize(frame.size() + 40, 0x33);
      collector.feed(frame, true);
    }
    EXPECT_EQ(collector.frames.size(), 6U);
    EXPECT_EQ(collector.counts().incomplete, 1);
    EXPECT_EQ(collector.counts().wrong_size, 1);
    EXPECT_EQ(collector.counts().lost, 0);
    expect_identity(collector);
  }
}

TEST(UsbFrameAssembler, FramesThatFindNoBufferAreLostAndTheStreamGoesOn) {
  for (const Kind& kind : kKinds) {
    SCOPED_TRACE(kind.name);
    const UsbLayout layout = stream_layout(16, kind.sync, kind.numbered);
    Collector collector(layout);
    for (std::uint32_t n = 0; n < 12; ++n) {
      collector.has_buffer = n < 3 || n > 6;
      collector.feed(stream_frame(layout, n), kind.short_packets);
    }
    EXPECT_GE(collector.counts().no_buffer, 3);
    EXPECT_EQ(collector.counts().lost, collector.counts().no_buffer);
    EXPECT_GE(collector.frames.size(), 6U);
    for (std::size_t i = 1; i < collector.frames.size(); ++i) {
      const bool gap = collector.frames[i].sequence != collector.frames[i - 1].sequence + 1;
      EXPECT_EQ(collector.frames[i].status, gap ? kFrameGapBefore : kFrameOk);
    }
    expect_identity(collector);
  }
}

TEST(UsbFrameAssembler, TheStampIsThatOfTheLastByte) {
  const UsbLayout layout = stream_layout(16, true, true);
  FrameBuffer buffer(usb_frame_format(layout));
  std::vector<FrameHeader> headers;
  UsbFrameAssembler assembler(
      layout, [&] { return &buffer; },
      [&](FrameBuffer* frame) {
        headers.push_back(frame->header);
        return frame;
      });
  const auto start = std::chrono::steady_clock::now();
  const auto feed_at = [&](const Bytes& bytes, int ms) {
    assembler.feed(std::as_bytes(std::span(bytes)), false,
                   {start + std::chrono::milliseconds(ms), 1000 + ms});
  };
  const Bytes frame = stream_frame(layout, 1);
  feed_at(Bytes(frame.begin(), frame.end() - 5), 1);
  feed_at(Bytes(frame.end() - 5, frame.end()), 2);
  feed_at(stream_frame(layout, 2), 3);
  ASSERT_EQ(headers.size(), 1U);
  EXPECT_EQ(headers[0].received, start + std::chrono::milliseconds(2));
  EXPECT_EQ(headers[0].received_ns, 1002);
  EXPECT_EQ(headers[0].camera_ns, 0);
}

TEST(UsbFrameAssembler, FeedingAllocatesNothing) {
  for (const Kind& kind : kKinds) {
    SCOPED_TRACE(kind.name);
    const UsbLayout layout = stream_layout(16, kind.sync, kind.numbered);
    FrameBuffer buffer(usb_frame_format(layout));
    int delivered = 0;
    UsbFrameAssembler assembler(
        layout, [&] { return &buffer; },
        [&](FrameBuffer* frame) {
          ++delivered;
          return frame;
        });
    std::vector<Bytes> frames;
    for (std::uint32_t n = 0; n < 40; ++n) {
      frames.push_back(stream_frame(layout, n));
      if (n % 7 == 3) frames.back().resize(100);
    }
    EXPECT_EQ(allocations_of_this_thread([&] {
                for (const Bytes& frame : frames) {
                  assembler.feed(std::as_bytes(std::span(frame)), kind.short_packets, {});
                }
              }),
              0);
    EXPECT_GT(delivered, 20);
  }
}

// It is far longer than the memory behind a frame's pixels.
TEST(UsbFrameAssembler, ATrailerIsNotTakenForPixels) {
  UsbLayout layout = stream_layout();
  layout.trailer_bytes = 32 << 20;
  Collector collector(layout);
  for (const std::uint32_t n : {7U, 8U}) collector.feed(stream_frame(layout, n), true);
  ASSERT_EQ(collector.frames.size(), 2U);
  EXPECT_EQ(collector.frames[1].pixels, stream_pixels(layout, 8));
}

TEST(UsbFrameAssembler, ALayoutThatMakesNoSenseIsRefusedByItsKey) {
  const auto text = [](auto&& change) {
    UsbLayout layout = stream_layout();
    change(layout);
    try {
      usb_frame_format(layout);
    } catch (const UsageError& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_EQ(text([](UsbLayout&) {}), "");
  EXPECT_NE(text([](UsbLayout& l) { l.rows = 0; }).find("[usb] rows"), std::string::npos);
  EXPECT_NE(text([](UsbLayout& l) { l.cols = 0; }).find("cols = 0"), std::string::npos);
  EXPECT_NE(text([](UsbLayout& l) { l.bits = 9; }).find("[usb] bits = 9"), std::string::npos);
  EXPECT_NE(text([](UsbLayout& l) { l.sync = "a55"; }).find("[usb] sync"), std::string::npos);
  EXPECT_NE(text([](UsbLayout& l) { l.sync = "zz"; }).find("[usb] sync"), std::string::npos);
  EXPECT_NE(text([](UsbLayout& l) { l.header_bytes = 3; }).find("header_bytes"), std::string::npos);
  EXPECT_NE(text([](UsbLayout& l) { l.header_bytes = -1; }).find("negative"), std::string::npos);
  EXPECT_NE(text([](UsbLayout& l) { l.trailer_bytes = -1; }).find("negative"), std::string::npos);
  EXPECT_NE(text([](UsbLayout& l) { l.sequence_offset = 13; }).find("[usb] sequence_offset"),
            std::string::npos);
  EXPECT_NE(text([](UsbLayout& l) { l.sequence_offset = 2; }).find("[usb] sequence_offset"),
            std::string::npos);
}

}  // namespace
}  // namespace curlew
