// The checks of machine_check.cpp, each a function: rights, processors, kernel, network and USB.
#pragma once

#include "service/doctor/machine_check.h"
#include "service/doctor/machine_files.h"

namespace curlew {

// machine_rights.cpp: what the user and the program are allowed to do.
Check check_build(const Machine& machine, const MachineFiles& files);
Check check_rtprio(const Machine& machine, const MachineFiles& files);
Check check_memlock(const Machine& machine, const MachineFiles& files);
Check check_dma_latency(const Machine& machine, const MachineFiles& files);

// machine_processors.cpp
Check check_cpu_count(const Machine& machine, const MachineFiles& files);
Check check_chosen_cpus(const Machine& machine, const MachineFiles& files);
Check check_isolation(const Machine& machine, const MachineFiles& files);
Check check_governor(const Machine& machine, const MachineFiles& files);
Check check_c_states(const Machine& machine, const MachineFiles& files);
Check check_virtual(const Machine& machine, const MachineFiles& files);

// machine_kernel.cpp
Check check_kernel(const Machine& machine, const MachineFiles& files);
Check check_rt_throttling(const Machine& machine, const MachineFiles& files);
Check check_clock_source(const Machine& machine, const MachineFiles& files);
Check check_huge_pages(const Machine& machine, const MachineFiles& files);
Check check_swap(const Machine& machine, const MachineFiles& files);

// machine_links.cpp: network and USB.
Check check_socket_buffer(const Machine& machine, const MachineFiles& files);
Check check_jumbo_frames(const Machine& machine, const MachineFiles& files);
Check check_camera_network(const Machine& machine, const MachineFiles& files);
Check check_packet_loss(const Machine& machine, const MachineFiles& files);
Check check_interface_losses(const Machine& machine, const MachineFiles& files);
Check check_usb_memory(const Machine& machine, const MachineFiles& files);

}  // namespace curlew
