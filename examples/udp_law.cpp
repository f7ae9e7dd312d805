// A guidance law in C++ that steers the simulated tractor over UDP. Change `law`; the rest handles messages.
//
//     c++ -std=c++17 -O2 -o udp_law udp_law.cpp
//     ./udp_law [own port, 9999] [port of the boards, 8888]
//
// Input: $PAOGI, position and heading of the antenna above the rear axle, 10 Hz. Output: message 254, the steering
// angle, with the engaged bit in byte 7. docs/extensions/links/link.md describes both. The line runs east through
// x = y = 0 of the scenario. Angles are in rad, left positive. The program ends 5 s after the last position, or after
// ten minutes without a position.

#include <arpa/inet.h>
#include <sys/socket.h>
#include <sys/time.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <sstream>
#include <string>
#include <vector>

constexpr double PI = 3.14159265358979323846;
constexpr double WHEELBASE = 1.4;    // tractor.wheelbase_m
constexpr double LATITUDE = 50.877;  // guidance.origin_lat_deg

// Steering angle [rad] of pure pursuit at a distance `left` [m] of the line, with the heading turned left by `heading`
// [rad], at `speed` [m/s].
double law(double left, double heading, double speed) {
    const double ahead = std::max(2.5, 2.0 * speed), c = std::cos(heading), s = std::sin(heading);
    const double across = -s * ahead - c * left;  // the goal, on the line, to the left of the tractor
    return std::atan(2.0 * WHEELBASE * across / (ahead * ahead + left * left));
}

// Degrees of an NMEA text "ddmm.mmmm".
double degrees(const std::string& text) {
    const double value = std::atof(text.c_str()), whole = std::floor(value / 100.0);
    return whole + (value - 100.0 * whole) / 60.0;
}

// Metres north of the origin, on the WGS 84 ellipsoid at this latitude.
double north_of(double latitude) {
    const double phi = LATITUDE * PI / 180.0;
    return (latitude - LATITUDE) * (111132.92 - 559.82 * std::cos(2 * phi) + 1.175 * std::cos(4 * phi));
}

// Message 254: speed [0.1 km/h], status (1: engaged), angle [0.01 deg, right positive], distance unknown, no sections.
std::vector<uint8_t> message(double speed, bool steers, double angle) {
    const int u = std::lround(speed * 36.0), d = std::lround(-angle * 18000.0 / PI);
    std::vector<uint8_t> frame{0x80, 0x81, 127, 254, 8};
    for (int byte : {u, u >> 8, int(steers), d, d >> 8, 255, 0, 0}) frame.push_back(uint8_t(byte));
    uint8_t sum = 0;
    for (size_t k = 2; k < frame.size(); ++k) sum += frame[k];
    frame.push_back(sum);
    return frame;
}

int main(int count, char** words) {
    const int own = count > 1 ? std::atoi(words[1]) : 9999, boards = count > 2 ? std::atoi(words[2]) : 8888;
    const int udp = socket(AF_INET, SOCK_DGRAM, 0);
    sockaddr_in here{}, there{};
    here.sin_family = there.sin_family = AF_INET;
    here.sin_addr.s_addr = there.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    here.sin_port = htons(own), there.sin_port = htons(boards);
    if (bind(udp, reinterpret_cast<sockaddr*>(&here), sizeof here) < 0) return std::perror("bind"), 1;

    char text[512];
    for (int heard = 0;;) {
        const timeval patience{heard ? 5 : 600, 0};  // [s]
        setsockopt(udp, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
        const ssize_t size = recv(udp, text, sizeof text, 0);
        if (size <= 0) return std::printf("%d positions\n", heard), heard ? 0 : 1;
        std::stringstream sentence(std::string(text, size));
        std::vector<std::string> f;
        for (std::string field; std::getline(sentence, field, ',');) f.push_back(field);
        if (f.size() != 16 || f[0] != "$PAOGI") continue;
        const double left = north_of(degrees(f[2]) * (f[3] == "S" ? -1 : 1));
        const double speed = std::atof(f[11].c_str()) / 1.94384;  // from knots
        const double heading = std::remainder(PI / 2 - std::atof(f[12].c_str()) * PI / 180.0, 2 * PI);
        const bool steers = ++heard > 10;  // a board engages only after a message without the engaged bit
        const auto answer = message(speed, steers, std::clamp(law(left, heading, speed), -0.785, 0.785));
        sendto(udp, answer.data(), answer.size(), 0, reinterpret_cast<sockaddr*>(&there), sizeof there);
    }
}
