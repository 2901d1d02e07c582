// Post a campaign file to a running service, and print the stiffness of each joint as CSV.
// Mono:  mcs -r:System.Net.Http.dll Identify.cs && mono Identify.exe http://127.0.0.1:8000 campaign.json
using System;
using System.IO;
using System.Net.Http;
using System.Text;
using System.Threading.Tasks;

static class Identify
{
    static void Main(string[] arguments) => Post(arguments[0], arguments[1]).GetAwaiter().GetResult();

    static async Task Post(string service, string file)
    {
        using (var client = new HttpClient { BaseAddress = new Uri(service), Timeout = TimeSpan.FromMinutes(2) })
        {
            // client.DefaultRequestHeaders.Add("Authorization", "Bearer KEY");  // if the service demands a key
            var campaign = new StringContent(File.ReadAllText(file), Encoding.UTF8, "application/json");
            var posted = await client.PostAsync("/v1/campaigns?wait=60", campaign);
            if (!posted.IsSuccessStatusCode)  // what is wrong, where, and how to mend it
                throw new Exception(await posted.Content.ReadAsStringAsync());
            var address = posted.Headers.Location.ToString().Split('/');
            var run = address[address.Length - 1];
            Console.Write(await client.GetStringAsync($"/v1/jobs/{run}/files/joints.csv"));
        }
    }
}
