#include "service/doctor/machine_check.h"

#include <algorithm>

#include "service/doctor/machine_check_list.h"

namespace curlew {
namespace {

struct NamedCheck {
  const char* name;
  Check (*examine)(const Machine&, const MachineFiles&);
};
constexpr std::array kChecks = {
    NamedCheck{"build", check_build},
    NamedCheck{"real-time priority", check_rtprio},
    NamedCheck{"memory lock", check_memlock},
    NamedCheck{"CPUs", check_cpu_count},
    NamedCheck{"pinning", check_chosen_cpus},
    NamedCheck{"isolated CPUs", check_isolation},
    NamedCheck{"CPU frequency", check_governor},
    NamedCheck{"C-states", check_c_states},
    NamedCheck{"C-state hold", check_dma_latency},
    NamedCheck{"kernel", check_kernel},
    NamedCheck{"real-time throttling", check_rt_throttling},
    NamedCheck{"clock source", check_clock_source},
    NamedCheck{"host", check_virtual},
    NamedCheck{"huge pages", check_huge_pages},
    NamedCheck{"swap", check_swap},
    NamedCheck{"socket buffer", check_socket_buffer},
    NamedCheck{"jumbo frames", check_jumbo_frames},
    NamedCheck{"camera's network", check_camera_network},
    NamedCheck{"UDP losses", check_packet_loss},
    NamedCheck{"interface losses", check_interface_losses},
    NamedCheck{"USB memory", check_usb_memory},
};

}  // namespace

std::vector<Check> check_machine(const Machine& machine) {
  const MachineFiles files(machine.root);
  std::vector<Check> checks;
  for (const NamedCheck& check : kChecks) {
    checks.push_back(check.examine(machine, files));
    checks.back().name = check.name;
  }
  return checks;
}

bool ready_for_real_time(const std::vector<Check>& checks) {
  return std::none_of(checks.begin(), checks.end(),
                      [](const Check& check) { return check.verdict == CheckVerdict::kBad; });
}

}  // namespace curlew
