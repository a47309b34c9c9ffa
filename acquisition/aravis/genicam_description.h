// A camera describes itself in XML (GenICam), which is looked at before it is used.
#pragma once

#include <string>
#include <string_view>

namespace curlew {

/// Throws Failure if the description would end the process that evaluates it, as Aravis 0.8.26
/// does: if it is cut off or no XML, if a feature's value refers to itself, or if a register has a
/// length that makes no sense. camera: how errors call it.
void check_genicam_description(std::string_view xml, const std::string& camera);

}  // namespace curlew
