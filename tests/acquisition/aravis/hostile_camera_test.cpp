// Cameras that say of themselves what would end the program, or forge its log, are found out before
// they are used.
#include <gtest/gtest.h>

#include <functional>
#include <string>

#include "acquisition/aravis/genicam_description.h"
#include "tests/acquisition/aravis/served_camera.h"
#include "tests/support/failure_text.h"

namespace curlew {
namespace {

using Edit = std::function<std::string(std::string)>;

Edit replaced(const std::string& from, const std::string& to) {
  return [=](std::string xml) {
    const std::size_t at = xml.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    return xml.replace(at, from.size(), to);
  };
}

/// Puts another feature in the place of one.
Edit feature(const std::string& kind, const std::string& name, const std::string& content) {
  return [=](std::string xml) {
    const std::size_t begin = xml.find("<" + kind + " Name=\"" + name + "\"");
    const std::string closing = "</" + kind + ">";
    const std::size_t end = xml.find(closing, begin);
    EXPECT_NE(end, std::string::npos) << name;
    return xml.replace(begin, end + closing.size() - begin, content);
  };
}

class HostileCamera : public ServedCamera {
 protected:
  /// Returns why the camera cannot be opened; empty if it can.
  std::string refusal(const Edit& edit) {
    FakeGigeOptions served;
    served.edit_description = edit;
    const auto server = serve(known_images(16, 16, kMono16), served);
    return failure_text([&] { open(); });
  }
};

TEST_F(HostileCamera, ADescriptionThatRefersToItselfIsRefused) {
  const std::string width = "<Integer Name=\"Width\" NameSpace=\"Standard\">";
  const std::string self = "<pValue>Width</pValue></Integer>";
  EXPECT_NE(refusal(feature("Integer", "Width", width + self)).find("Width refers to itself"),
            std::string::npos);
  // Over another one.
  EXPECT_NE(refusal(feature("Integer", "Width",
                            width + "<pValue>Way</pValue></Integer><Integer Name=\"Way\">" + self))
                .find("refers to itself"),
            std::string::npos);
  EXPECT_NE(refusal(replaced("<Address>0x100</Address>", "<pAddress>Width</pAddress>"))
                .find("refers to itself"),
            std::string::npos);
  EXPECT_NE(refusal(feature("IntSwissKnife", "PayloadSize",
                            "<IntSwissKnife Name=\"PayloadSize\"><pVariable "
                            "Name=\"A\">PayloadSize</pVariable><Formula>A+1</Formula></"
                            "IntSwissKnife>"))
                .find("PayloadSize refers to itself"),
            std::string::npos);
}

TEST_F(HostileCamera, ADescriptionThatIsCutOffIsRefused) {
  for (const double part : {0.1, 0.5, 0.9, 0.999})
    EXPECT_NE(refusal([&](const std::string& xml) {
                return xml.substr(0,
                                  static_cast<std::size_t>(part * static_cast<double>(xml.size())));
              }).find("cut off or damaged"),
              std::string::npos)
        << part;
}

TEST_F(HostileCamera, SizesThatMakeNoSenseAreRefused) {
  for (const char* size : {"-1", "4000000000", "0", "100"})
    EXPECT_NE(refusal(feature("IntSwissKnife", "PayloadSize",
                              std::string("<Integer Name=\"PayloadSize\"><Value>") + size +
                                  "</Value></Integer>"))
                  .find("PayloadSize"),
              std::string::npos)
        << size;
  for (const char* length : {"-5", "0", "1000000000"})
    EXPECT_NE(
        refusal(replaced("<Length>32</Length>", std::string("<Length>") + length + "</Length>"))
            .find("has a length of"),
        std::string::npos)
        << length;
}

// Good descriptions have circles as well, among limits.
TEST_F(HostileCamera, LimitsMayReferToEachOther) {
  EXPECT_EQ(refusal(replaced("<pMax>SensorWidth</pMax>", "<pMax>Height</pMax>")), "");
  EXPECT_EQ(refusal(replaced("</RegisterDescription>", "<!-- \xB5m --></RegisterDescription>")),
            "");
}

TEST_F(HostileCamera, ANameCannotForgeALineOfTheLog) {
  FakeGigeOptions served;
  served.vendor = "Good\nerror: \x1b[2Jno";
  const auto server = serve(known_images(16, 16, kMono16), served);
  EXPECT_EQ(open()->description(),
            "Good\\x0aerror: \\x1b[2Jno Fake, serial number CURLEW, 127.0.0.1");
}

// A frame of as many bytes but of another shape would be taken apart wrongly.
// Aravis would follow them by recursion.
TEST(GenicamDescription, AValueThatNeedsVeryManyOthersIsRefused) {
  const auto chain = [](int length) {
    std::string xml = "<RegisterDescription>";
    for (int i = 0; i < length; ++i)
      xml += "<Integer Name=\"F" + std::to_string(i) + "\"><pValue>F" + std::to_string(i + 1) +
             "</pValue></Integer>";
    return xml + "</RegisterDescription>";
  };
  EXPECT_EQ(failure_text([&] { check_genicam_description(chain(1000), "a camera"); }), "");
  const std::string text =
      failure_text([&] { check_genicam_description(chain(30'000), "a camera"); });
  EXPECT_NE(text.find("very many others"), std::string::npos) << text;
}

TEST_F(HostileCamera, FramesOfAnotherShapeAreCountedAndNeverDelivered) {
  const KnownImages images = known_images(64, 64, kMono16);
  const auto server = serve(images);
  const auto camera = open();
  FrameExchange exchange(camera->format(), 8);
  Taker taker(exchange, images);
  camera->start(exchange);
  ASSERT_TRUE(taker.take(3));
  server->deform(128, 32);
  for (int i = 0; i < 1000 && camera->counts().wrong_size < 5; ++i) taker.take_one(10'000);
  const std::int64_t delivered = camera->counts().delivered;
  for (int i = 0; i < 10; ++i) taker.take_one(10'000);
  EXPECT_GE(camera->counts().wrong_size, 5);
  EXPECT_EQ(camera->counts().delivered, delivered);
  server->deform(64, 64);
  EXPECT_TRUE(taker.take(3));
  camera->stop();
}

}  // namespace
}  // namespace curlew
