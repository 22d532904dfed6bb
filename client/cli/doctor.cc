// doctor: what stands between this machine and a served map, one line a check.
#include "client/cli/doctor.h"

#include <openssl/err.h>
#include <openssl/pem.h>
#include <openssl/x509.h>
#include <sys/statvfs.h>

#include <cmath>
#include <iostream>
#include <memory>

#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "client/cli/context.h"
#include "client/cli/print.h"

namespace clearance::cli {

#ifndef CLEARANCE_VERSION
#define CLEARANCE_VERSION "unknown"
#endif

Finding CheckCertificate(const std::string& path, absl::Time now) {
  constexpr int kSoonDays = 14;
  const std::string name = "certificate " + path;
  std::unique_ptr<FILE, int (*)(FILE*)> file(fopen(path.c_str(), "rb"), fclose);
  if (!file) return {Finding::kBad, name, "cannot be read"};
  std::unique_ptr<X509, void (*)(X509*)> certificate(
      PEM_read_X509(file.get(), nullptr, nullptr, nullptr), X509_free);
  ERR_clear_error();
  if (!certificate) return {Finding::kBad, name, "holds no PEM certificate"};
  time_t at = absl::ToTimeT(now);
  if (X509_cmp_time(X509_get0_notBefore(certificate.get()), &at) > 0) {
    return {Finding::kBad, name, "is not valid yet: is this machine's clock right?"};
  }
  int days = 0, seconds = 0;
  std::unique_ptr<ASN1_TIME, void (*)(ASN1_TIME*)> today(ASN1_TIME_set(nullptr, at),
                                                         ASN1_TIME_free);
  ASN1_TIME_diff(&days, &seconds, today.get(), X509_get0_notAfter(certificate.get()));
  if (days < 0 || seconds < 0) return {Finding::kBad, name, "has expired: renew it"};
  return {days < kSoonDays ? Finding::kWarning : Finding::kGood, name,
          absl::StrFormat("valid for %d days%s", days, days < kSoonDays ? ": renew it soon" : "")};
}

Finding CheckDisk(const std::string& path) {
  struct statvfs disk;
  if (statvfs(path.c_str(), &disk) != 0) return {Finding::kBad, "disk " + path, "is not there"};
  const uint64_t free = static_cast<uint64_t>(disk.f_bavail) * disk.f_frsize;
  const double share = disk.f_blocks ? static_cast<double>(disk.f_bavail) / disk.f_blocks : 0;
  const bool low = free < (uint64_t{1} << 30) || share < 0.05;
  return {low ? Finding::kWarning : Finding::kGood, "disk " + path,
          absl::StrFormat("%s free (%.0f %%)%s", Bytes(free), share * 100,
                          low ? ": logs and snapshots will soon be refused" : "")};
}

std::vector<Finding> CheckServer(const client::ServerInfo& info, const client::ServerStats& stats) {
  std::vector<Finding> findings;
  findings.push_back(
      {info.version == CLEARANCE_VERSION ? Finding::kGood : Finding::kWarning, "versions",
       absl::StrFormat("server %s, this command %s", info.version, CLEARANCE_VERSION)});
  findings.push_back(
      info.draining
          ? Finding{Finding::kWarning, "draining", "the server takes no more frames"}
          : Finding{Finding::kGood, "serving", absl::StrFormat("up %.0f s", info.uptime_s)});
  for (const client::MapStats& map : stats.maps) {
    const std::string name = "map " + map.map;
    const uint64_t settled = map.frames_integrated + map.frames_dropped + map.frames_rejected;
    if (settled == 0) {
      findings.push_back({Finding::kGood, name, "no frames yet"});
    } else if (map.frames_rejected * 20 > settled) {
      findings.push_back({Finding::kWarning, name,
                          absl::StrFormat("%d of %d frames were rejected: read their acks",
                                          map.frames_rejected, settled)});
    } else if (map.frames_dropped * 20 > settled) {
      findings.push_back({Finding::kWarning, name,
                          absl::StrFormat("%d of %d frames were dropped: the source is faster than "
                                          "the map",
                                          map.frames_dropped, settled)});
    } else if (map.queue_length >= map.queue_capacity && map.queue_capacity > 0) {
      findings.push_back({Finding::kWarning, name, "its queue is full"});
    } else {
      findings.push_back(
          {Finding::kGood, name,
           absl::StrFormat("%d frames, newest %.1f s ago", settled, map.stamp.staleness_s)});
    }
  }
  return findings;
}

namespace {

absl::Status Doctor(const Context& context, const std::vector<std::string>& certificates,
                    const std::vector<std::string>& folders) {
  std::vector<Finding> findings;
  for (const std::string& path : certificates) {
    findings.push_back(CheckCertificate(path, absl::Now()));
  }
  for (const std::string* path :
       {&context.credentials.tls_ca, &context.credentials.tls_certificate}) {
    if (!path->empty()) findings.push_back(CheckCertificate(*path, absl::Now()));
  }
  for (const std::string& path : folders) findings.push_back(CheckDisk(path));
  const auto client = context.Connect();
  if (!client.ok()) {
    findings.push_back({Finding::kBad, "server", std::string(client.status().message())});
  } else {
    const auto info = (*client)->GetServerInfo();
    const auto stats = (*client)->GetStats(context.map);
    for (const absl::Status& status : {info.status(), stats.status()}) {
      if (!status.ok()) {
        findings.push_back({Finding::kBad, "server", std::string(status.message())});
      }
    }
    if (info.ok() && stats.ok()) {
      for (Finding& finding : CheckServer(*info, *stats)) findings.push_back(std::move(finding));
    }
  }
  static constexpr const char* kLevels[] = {"ok", "look", "BAD"};
  int bad = 0;
  Json json = Json::array();
  Table table({"", "what", "finding"});
  for (const Finding& finding : findings) {
    bad += finding.level == Finding::kBad;
    table.Add({kLevels[finding.level], finding.what, finding.text});
    json.push_back(
        {{"level", kLevels[finding.level]}, {"what", finding.what}, {"finding", finding.text}});
  }
  if (context.json) {
    PrintJson(json);
  } else {
    std::cout << table.Text();
  }
  if (bad == 0) return absl::OkStatus();
  return absl::UnavailableError(absl::StrFormat("%d of %d checks failed", bad, findings.size()));
}

}  // namespace

void AddDoctor(CLI::App& app, Context& context) {
  auto certificates = std::make_shared<std::vector<std::string>>();
  auto folders = std::make_shared<std::vector<std::string>>();
  CLI::App* command = AddCommand(
      app, context, "doctor", "checks server, versions, maps, certificates and disks",
      [&context, certificates, folders] { return Doctor(context, *certificates, *folders); });
  command->add_option("--certificate", *certificates, "PEM files to look at, such as the server's");
  command->add_option("--disk", *folders, "folders to look at, such as the log's");
}

}  // namespace clearance::cli
