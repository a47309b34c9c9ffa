#include "tests/acquisition/usb/emulated_vision_camera.h"

#include <chrono>
#include <cstring>
#include <string>
#include <thread>

namespace curlew {
namespace {

constexpr int kControlIn = 0x81;
constexpr int kStreamIn = 0x82;
constexpr std::size_t kPacket = 1024;
constexpr std::uint32_t kMono16 = 0x01100007;

// The registers are here. The first table's place is fixed by the standard (GenCP, U3V).
constexpr std::size_t kSbrm = 0x1000;
constexpr std::size_t kSirm = 0x2000;
constexpr std::size_t kManifest = 0x3000;
constexpr std::size_t kFeatures = 0x4000;
constexpr std::size_t kWidth = kFeatures;
constexpr std::size_t kHeight = kFeatures + 4;
constexpr std::size_t kOffsetX = kFeatures + 8;
constexpr std::size_t kOffsetY = kFeatures + 12;
constexpr std::size_t kPixelFormat = kFeatures + 16;
constexpr std::size_t kPayloadSize = kFeatures + 20;
constexpr std::size_t kStart = kFeatures + 24;
constexpr std::size_t kStop = kFeatures + 28;
constexpr std::size_t kRunning = kFeatures + 32;
constexpr std::size_t kXml = 0x8000;

template <typename T>
void put(Bytes& bytes, std::size_t at, T value) {
  if (bytes.size() < at + sizeof value) bytes.resize(at + sizeof value);
  std::memcpy(bytes.data() + at, &value, sizeof value);
}
template <typename T>
T read(const Bytes& bytes, std::size_t at) {
  T value{};
  std::memcpy(&value, bytes.data() + at, sizeof value);
  return value;
}
template <typename T>
void append(Bytes& bytes, T value) {
  put(bytes, bytes.size(), value);
}
void put_text(Bytes& bytes, std::size_t at, const std::string& text) {
  std::memcpy(bytes.data() + at, text.data(), text.size());
}

std::string element(const std::string& name, const std::string& value) {
  return std::string("<").append(name).append(">").append(value).append("</").append(name).append(
      ">");
}

std::string register_body(std::size_t address, int bytes, const std::string& access) {
  return element("Address", std::to_string(address)) + element("Length", std::to_string(bytes)) +
         element("AccessMode", access) + element("pPort", "Device");
}

std::string node(const std::string& type, const std::string& name, const std::string& body) {
  return std::string("<")
      .append(type)
      .append(" Name=\"")
      .append(name)
      .append("\">")
      .append(body)
      .append("</")
      .append(type)
      .append(">\n");
}

/// Describes an unsigned 32-bit register and the integer feature that it holds.
std::string integer(const std::string& name, std::size_t address, const std::string& access,
                    int maximum) {
  return node("IntReg", name + "Reg",
              register_body(address, 4, access) + element("Sign", "Unsigned") +
                  element("Endianess", "LittleEndian")) +
         node("Integer", name,
              element("pValue", name + "Reg") + element("Min", "0") +
                  element("Max", std::to_string(maximum)));
}

std::string command(const std::string& name, std::size_t address) {
  return node("IntReg", name + "Reg",
              register_body(address, 4, "RW") + element("Sign", "Unsigned") +
                  element("Endianess", "LittleEndian")) +
         node("Command", name, element("pValue", name + "Reg") + element("CommandValue", "1"));
}

std::string text_register(const std::string& name, std::size_t address) {
  return node("StringReg", name, register_body(address, 64, "RO"));
}

std::string genicam(int rows, int cols) {
  std::string features;
  std::string nodes;
  const auto feature = [&](const std::string& name, const std::string& text) {
    features += element("pFeature", name);
    nodes += text;
  };
  feature("DeviceVendorName", text_register("DeviceVendorName", 0x04));
  feature("DeviceModelName", text_register("DeviceModelName", 0x44));
  feature("DeviceSerialNumber", text_register("DeviceSerialNumber", 0x144));
  feature("Width", integer("Width", kWidth, "RW", cols));
  feature("Height", integer("Height", kHeight, "RW", rows));
  feature("WidthMax", node("Integer", "WidthMax", element("Value", std::to_string(cols))));
  feature("HeightMax", node("Integer", "HeightMax", element("Value", std::to_string(rows))));
  feature("OffsetX", integer("OffsetX", kOffsetX, "RW", 0));
  feature("OffsetY", integer("OffsetY", kOffsetY, "RW", 0));
  feature("PayloadSize", integer("PayloadSize", kPayloadSize, "RO", 1 << 30));
  nodes += node("IntReg", "PixelFormatReg",
                register_body(kPixelFormat, 4, "RW") + element("Sign", "Unsigned") +
                    element("Endianess", "LittleEndian"));
  feature("PixelFormat",
          node("Enumeration", "PixelFormat",
               node("EnumEntry", "Mono16", element("Value", std::to_string(kMono16))) +
                   element("pValue", "PixelFormatReg")));
  feature("AcquisitionMode",
          node("Enumeration", "AcquisitionMode",
               node("EnumEntry", "Continuous", element("Value", "0")) + element("Value", "0")));
  feature("AcquisitionStart", command("AcquisitionStart", kStart));
  feature("AcquisitionStop", command("AcquisitionStop", kStop));
  return std::string("<?xml version=\"1.0\"?>\n<RegisterDescription ModelName=\"Vision1\" ") +
         "VendorName=\"CurlewWorks\" StandardNameSpace=\"U3V\" SchemaMajorVersion=\"1\" "
         "SchemaMinorVersion=\"1\" SchemaSubMinorVersion=\"0\" MajorVersion=\"1\" "
         "MinorVersion=\"0\" SubMinorVersion=\"0\">\n" +
         node("Category", "Root", features) + nodes + node("Port", "Device", "") +
         "</RegisterDescription>\n";
}

UsbIdentity identity() {
  return {0x1d50,
          0x60a2,
          EmulatedVisionCamera::kVendor,
          EmulatedVisionCamera::kModel,
          EmulatedVisionCamera::kSerial,
          kPacket,
          {18, 1, 0,    3, 0xef, 2,    1, 9,    0x50, 0x1d, 0xa2, 0x60, 0, 1, 1, 2, 3, 1,  // device
           9,  2, 48,   0, 2,    1,    0, 0x80, 100,  // configuration
           9,  4, 0,    0, 2,    0xef, 5, 0,    0,    // control
           7,  5, 0x81, 2, 0,    4,    0,             //   in
           7,  5, 0x01, 2, 0,    4,    0,             //   out
           9,  4, 1,    0, 1,    0xef, 5, 2,    0,    // stream
           7,  5, 0x82, 2, 0,    4,    0}};
}

}  // namespace

EmulatedVisionCamera::EmulatedVisionCamera(int rows, int cols, int padding_bytes)
    : EmulatedUsbDevice(identity()),
      rows_(rows),
      cols_(cols),
      padding_(padding_bytes),
      claimed_padding_(padding_bytes),
      memory_(kXml) {
  put<std::uint32_t>(memory_, 0x000, 0x00010000);
  put_text(memory_, 0x004, kVendor);
  put_text(memory_, 0x044, kModel);
  put_text(memory_, 0x144, kSerial);
  put<std::uint32_t>(memory_, 0x1cc, 300);  // longest time for an answer, ms
  put<std::uint64_t>(memory_, 0x1d0, kManifest);
  put<std::uint64_t>(memory_, 0x1d8, kSbrm);
  put<std::uint32_t>(memory_, kSbrm, 0x00010000);
  put<std::uint32_t>(memory_, kSbrm + 0x14, kPacket);  // longest command
  put<std::uint32_t>(memory_, kSbrm + 0x18, kPacket);  // longest answer
  put<std::uint32_t>(memory_, kSbrm + 0x1c, 1);
  put<std::uint64_t>(memory_, kSbrm + 0x20, kSirm);
  put<std::uint32_t>(memory_, kSbrm + 0x28, 0x30);
  const auto payload = static_cast<std::uint32_t>(rows * (2 * cols + padding_bytes));
  put<std::uint32_t>(memory_, kSirm, 10U << 24);  // transfers are multiples of 2^10 bytes
  put<std::uint64_t>(memory_, kSirm + 0x08, payload);
  put<std::uint32_t>(memory_, kSirm + 0x10, kPacket);
  put<std::uint32_t>(memory_, kSirm + 0x14, kPacket);
  put<std::uint32_t>(memory_, kWidth, static_cast<std::uint32_t>(cols));
  put<std::uint32_t>(memory_, kHeight, static_cast<std::uint32_t>(rows));
  put<std::uint32_t>(memory_, kPixelFormat, kMono16);
  put<std::uint32_t>(memory_, kPayloadSize, payload);
  const std::string xml = genicam(rows, cols);
  put<std::uint64_t>(memory_, kManifest, 1);
  put<std::uint64_t>(memory_, kManifest + 8 + 8, kXml);
  put<std::uint64_t>(memory_, kManifest + 8 + 16, xml.size());
  memory_.resize(kXml + xml.size());
  put_text(memory_, kXml, xml);
}

EmulatedVisionCamera::~EmulatedVisionCamera() { retire(); }

bool EmulatedVisionCamera::acquiring() const {
  const std::lock_guard lock(memory_mutex_);
  return read<std::uint32_t>(memory_, kRunning) == 1 &&
         (read<std::uint32_t>(memory_, kSirm + 4) & 1U) == 1;
}

bool EmulatedVisionCamera::wait_until_acquiring() const {
  for (int i = 0; i < 2000 && !acquiring(); ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  return acquiring();
}

bool EmulatedVisionCamera::send_leader(std::uint64_t id) {
  Bytes leader;
  append<std::uint32_t>(leader, 0x4c563355);
  append<std::uint16_t>(leader, 0);
  append<std::uint16_t>(leader, 52);
  append<std::uint64_t>(leader, id);
  append<std::uint16_t>(leader, 0);
  append<std::uint16_t>(leader, 1);             // This is an image.
  append<std::uint64_t>(leader, 1000000 * id);  // its time, ns
  append<std::uint32_t>(leader, kMono16);
  append<std::uint32_t>(leader, static_cast<std::uint32_t>(cols_));
  append<std::uint32_t>(leader, static_cast<std::uint32_t>(rows_));
  append<std::uint64_t>(leader, 0);  // offsets
  append<std::uint16_t>(leader, static_cast<std::uint16_t>(claimed_padding_));
  append<std::uint16_t>(leader, 0);
  return send(kStreamIn, leader, true);
}

bool EmulatedVisionCamera::send_frame(std::uint64_t id, std::span<const std::uint16_t> pixels) {
  Bytes payload;
  const auto* from = reinterpret_cast<const std::uint8_t*>(pixels.data());
  const auto line = static_cast<std::size_t>(2 * cols_);
  for (std::size_t at = 0; at < pixels.size_bytes(); at += line) {
    payload.insert(payload.end(), from + at, from + at + line);
    payload.insert(payload.end(), static_cast<std::size_t>(padding_), 0xEE);
  }
  Bytes trailer;
  append<std::uint32_t>(trailer, 0x54563355);
  append<std::uint16_t>(trailer, 0);
  append<std::uint16_t>(trailer, 32);
  append<std::uint64_t>(trailer, id);
  append<std::uint32_t>(trailer, 0);  // success
  append<std::uint64_t>(trailer, payload.size());
  append<std::uint32_t>(trailer, static_cast<std::uint32_t>(rows_));
  return send_leader(id) && send(kStreamIn, payload, payload.size() % kPacket != 0) &&
         send(kStreamIn, trailer, true);
}

bool EmulatedVisionCamera::send_part_of_frame(std::uint64_t id,
                                              std::span<const std::uint16_t> pixels,
                                              std::size_t bytes) {
  return send_leader(id) &&
         send(kStreamIn, {reinterpret_cast<const std::uint8_t*>(pixels.data()), bytes}, false);
}

/// Answers GenCP commands, which read and write memory.
void EmulatedVisionCamera::received(int /*endpoint*/, const Bytes& bytes) {
  constexpr std::uint16_t kReadMemory = 0x0800;
  constexpr std::uint16_t kWriteMemory = 0x0802;
  const auto what = read<std::uint16_t>(bytes, 6);
  const auto address = read<std::uint64_t>(bytes, 12);
  Bytes data;
  std::uint16_t status = 0;
  {
    const std::lock_guard lock(memory_mutex_);
    if (what == kReadMemory) {
      const auto size = read<std::uint16_t>(bytes, 22);
      if (address + size <= memory_.size()) {
        const auto from = memory_.begin() + static_cast<std::ptrdiff_t>(address);
        data.assign(from, from + size);
      } else {
        status = 0x8003;  // no such address
      }
    } else if (what == kWriteMemory && address + bytes.size() - 20 <= memory_.size()) {
      std::memcpy(memory_.data() + address, bytes.data() + 20, bytes.size() - 20);
      if (address == kStart) put<std::uint32_t>(memory_, kRunning, 1);
      if (address == kStop) put<std::uint32_t>(memory_, kRunning, 0);
      append<std::uint16_t>(data, 0);
      append<std::uint16_t>(data, static_cast<std::uint16_t>(bytes.size() - 20));
    } else {
      status = 0x8001;  // not implemented
    }
  }
  Bytes answer;
  append<std::uint32_t>(answer, 0x43563355);
  append<std::uint16_t>(answer, status);
  append<std::uint16_t>(answer, static_cast<std::uint16_t>(what + 1));
  append<std::uint16_t>(answer, static_cast<std::uint16_t>(data.size()));
  append<std::uint16_t>(answer, read<std::uint16_t>(bytes, 10));
  answer.insert(answer.end(), data.begin(), data.end());
  send(kControlIn, answer, answer.size() % kPacket != 0);
}

}  // namespace curlew
